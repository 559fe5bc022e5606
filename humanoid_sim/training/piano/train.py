"""Train the pointer: on generated songs, in the company of its own mistakes (DAgger, Ross et al. 2011)."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import torch
from torch import nn

from humanoid_sim.evaluation.key_poses import KeyPoses
from humanoid_sim.evaluation.piano_player import APART, HOME
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.random_songs import random_song
from humanoid_sim.policy.song import Note, Song, goals
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.training import TrainPianoConfig
from humanoid_sim.training.piano.export import POLICY_DT, export_piano_policy
from humanoid_sim.training.piano.hands import FAR, HOVERING, QUARTERS, Motion, home
from humanoid_sim.training.piano.pointer import OFFSETS, Pointer, key_features, times

__all__ = ["hands_of_notes", "train_piano"]

_SECONDS = 14.0
_CANDIDATES = 8
"""Keys that are looked at while training, the soonest; no song asks for more."""
_BATCH = 2048
_SOUNDS = 6
"""Level from which on a key is taken for down while training."""
_TRAVEL, _PER_KEY = 4, 0.5
"""Steps of a way to another key, and beyond them for each semitone."""
_READY = 0.25
"""s from the end of a note to the start of the next of the same hand, on another key, at least."""
_BESIDE = 0.3
"""s after its last note for which a hand is in the other's way."""
_IMPOSSIBLE, _CROSSED, _LATE = 1e5, 1e3, 200.0
"""What it costs, in semitones of way, that a hand cannot reach a key, is beyond the other, is late by a second."""
_CUT = 5
"""Steps by which a note ends sooner at most, for its hand to be in time for the next."""


@dataclass(frozen=True, slots=True, eq=False)
class _Lesson:
    """Songs side by side: what is seen, and where each hand should go."""

    wait: npt.NDArray[np.int16]
    """Shape (S, F, 88), steps."""
    left: npt.NDArray[np.int16]
    target: npt.NDArray[np.int64]
    """Shape (S, F, 2): the key of each hand's next note, -1 for none."""


def train_piano(config: TrainPianoConfig) -> int:
    """Train as the options say, and write the policy; the exit status."""
    output = Path(config.output)
    torch.manual_seed(config.seed)
    torch.set_num_threads(1)  # more are little faster, and sum in another order
    rng = np.random.default_rng(config.seed)
    description = load_robot("lite_piano")
    poses = KeyPoses.of(description)
    lesson = _lesson(description, rng, config.songs)
    network, motion = Pointer(), Motion()
    collected: list[tuple[FloatArray, FloatArray, npt.NDArray[np.int64]]] = []
    optimiser = torch.optim.Adam(network.parameters(), lr=2e-3)
    for number in range(config.rounds):
        collected.append(_walk(lesson, poses, motion, network if number else None, rng))
        features, asked, target = (np.concatenate(part) for part in zip(*collected, strict=True))
        x, mask = torch.from_numpy(features.astype(np.float32)), torch.from_numpy(asked.astype(np.float32))
        y = torch.from_numpy(target)
        for epoch in range(config.epochs):
            for group in optimiser.param_groups:
                group["lr"] = 2e-3 * (0.3 if number + 1 == config.rounds and epoch + 1 == config.epochs else 1.0)
            loss, right = _epoch(network, optimiser, x, mask, y)
            print(f"round {number + 1}, epoch {epoch + 1}: loss {loss:.4f}, {100.0 * right:.2f} % right", flush=True)
    weights = {name: value.detach().numpy() for name, value in network.state_dict().items()}
    export_piano_policy(output, weights, poses, description, motion)
    print(f"{output}: {sum(value.size for value in weights.values())} weights")
    return 0


def _epoch(
    network: nn.Module, optimiser: torch.optim.Optimizer, x: torch.Tensor, mask: torch.Tensor, y: torch.Tensor
) -> tuple[float, float]:
    total, right, count = 0.0, 0.0, 0
    for rows in torch.randperm(len(x)).split(_BATCH):
        scores = network(x[rows], mask[rows])
        loss = nn.functional.cross_entropy(scores, y[rows])
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        total += float(loss.detach()) * len(rows)
        right += float((scores.argmax(dim=1) == y[rows]).float().mean()) * len(rows)
        count += len(rows)
    return total / count, right / count


def _lesson(description: RobotDescription, rng: np.random.Generator, count: int) -> _Lesson:
    assert description.piano is not None
    hands = description.piano.hands
    frames = round(_SECONDS / POLICY_DT) + 2
    wait, left = (np.empty((count, frames, 88), dtype=np.int16) for _ in range(2))
    target = np.full((count, frames, 2), -1, dtype=np.int64)
    for i in range(count):
        song = random_song(rng, hands, seconds=_SECONDS, lead_in=float(rng.uniform(0.5, 1.2)))
        table = np.zeros((frames, 88))
        rows = goals(song, POLICY_DT)[:frames]
        table[: len(rows)] = rows
        seen = table[np.minimum(np.arange(frames)[:, None] + OFFSETS.astype(int), frames - 1)]
        wait[i], left[i] = times(seen)
        for hand, own in enumerate(hands_of_notes(song, hands)):
            target[i, :, hand] = _targets(own, frames)
    return _Lesson(wait, left, target)


def hands_of_notes(song: Song, reach: Sequence[Collection[int]]) -> tuple[list[Note], list[Note]]:
    """The notes that each hand takes: of two at a time the lower is the left hand's, and else the nearer hand's.

    Nearer counts the time that a hand has left, and that hands do not cross.

    Args:
        song: to be played.
        reach: the keys of each hand.
    """
    taken: tuple[list[Note], list[Note]] = ([], [])
    over, free = [float(key) for key in HOME], [0.0, 0.0]
    for i, note in enumerate(song.notes):
        costs = []
        for hand in (0, 1):
            side, other = (1 if hand == 0 else -1), 1 - hand
            cost = 0.0 if note.key in reach[hand] else _IMPOSSIBLE
            way = abs(note.key - over[hand])
            cost += way + _LATE * max(_READY + _PER_KEY * POLICY_DT * way - (note.start - free[hand]), 0.0)
            if free[other] > note.start - _BESIDE and side * (over[other] - note.key) < APART:
                cost += _CROSSED
            for coming in song.notes[i + 1 : i + 3]:
                if coming.start < note.end and side * (coming.key - note.key) < 0:
                    cost += _CROSSED
            costs.append(cost)
        hand = int(costs[1] < costs[0])
        taken[hand].append(note)
        over[hand], free[hand] = note.key, note.end
    return taken


def _targets(own: Sequence[Note], frames: int) -> npt.NDArray[np.int64]:
    """The key of the note that a hand should be at or on its way to, shape (F,); it leaves in time for the next."""
    motion = Motion()
    found = np.full(frames, -1, dtype=np.int64)
    frame = 0
    for note, following in zip(own, [*own[1:], None], strict=True):
        start, end = round(note.start / POLICY_DT), round(note.end / POLICY_DT)
        leaves = max(end, start + 1)
        if following is not None:
            way = 0.0 if following.key == note.key else _TRAVEL + _PER_KEY * abs(following.key - note.key)
            must = round(following.start / POLICY_DT - way) - motion.lead - 2 + motion.stops
            leaves = min(leaves, max(must, (start + end) // 2, end - _CUT))
        first = max(frame, start - int(OFFSETS[-1]))
        frame = max(frame, leaves - motion.stops)
        found[first:frame] = note.key
    return found


def _walk(
    lesson: _Lesson, poses: KeyPoses, motion: Motion, network: Pointer | None, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, npt.NDArray[np.int64]]:
    """Go through all songs at once, led by the lesson, or by the network; what was seen, and what would be right.

    Returns:
        Features (M, C, FEATURES), asked (M, C), and right answers (M, 2): a candidate, or C for none.
    """
    count, frames = lesson.wait.shape[:2]
    lowest = np.array([keys[0] for keys in poses.keys], dtype=np.float64)
    highest = np.array([keys[-1] for keys in poses.keys])
    hands = np.tile(home(poses), (count, 1, 1))
    rows = np.arange(count)
    found: list[tuple[FloatArray, FloatArray, npt.NDArray[np.int64]]] = []
    for frame in range(frames):
        wait, left = (part[:, frame].astype(np.float64) for part in (lesson.wait, lesson.left))
        place, level = hands[..., 0], hands[..., 1]
        pressed = np.zeros((count, 88))
        for hand in (0, 1):
            key = (place[:, hand] // QUARTERS + int(lowest[hand])).astype(int)
            pressed[rows, key] = np.maximum(pressed[rows, key], level[:, hand] >= _SOUNDS)
        features = key_features(wait, left, pressed, place.astype(float), level.astype(float), lowest)
        soonest = np.argsort(wait, axis=1, kind="stable")[:, :_CANDIDATES]
        chosen = features[rows[:, None], soonest]
        asked = (wait[rows[:, None], soonest] < FAR).astype(np.float64)
        right = np.full((count, 2), _CANDIDATES, dtype=np.int64)
        for hand in (0, 1):
            matches = (soonest == lesson.target[:, frame, hand, None]) & (asked > 0.0)
            right[:, hand] = np.where(matches.any(axis=1), matches.argmax(axis=1), _CANDIDATES)
        keep = rng.random(count) < 0.5
        found.append((chosen[keep].astype(np.float32), asked[keep].astype(np.float32), right[keep]))
        answer = right
        if network is not None:
            with torch.no_grad():
                scores = network(*(torch.from_numpy(part.astype(np.float32)) for part in (chosen, asked)))
            answer = scores.argmax(dim=1).numpy()
        elif frame % 7 == 0:  # now and then a hand is elsewhere
            strays = (rng.random((count, 2)) < 0.05) & (level <= HOVERING)
            strayed = np.where(strays, place + rng.integers(-16, 17, (count, 2)), place)
            hands[..., 0] = np.clip(strayed, 0, (highest - lowest.astype(int)) * QUARTERS)
        for hand in (0, 1):
            own, reach = hands[:, hand], (int(lowest[hand]), int(highest[hand]))
            hands[:, hand] = _advance(motion, own, answer[:, hand], soonest, wait, left, reach)
    features_all, asked_all, right_all = zip(*found, strict=True)
    return np.concatenate(features_all), np.concatenate(asked_all), np.concatenate(right_all)


def _advance(
    motion: Motion,
    hand: npt.NDArray[np.int64],
    answer: npt.NDArray[np.int64],
    soonest: npt.NDArray[np.int64],
    wait: FloatArray,
    left: FloatArray,
    reach: tuple[int, int],
) -> npt.NDArray[np.int64]:
    """Place and level, shape (S, 2), of a hand that was pointed at a candidate (S,), or at none."""
    rows = np.arange(len(hand))
    points = answer < soonest.shape[1]
    key = np.clip(soonest[rows, np.minimum(answer, soonest.shape[1] - 1)], *reach)
    resting = np.round(hand[:, 0] / QUARTERS).astype(np.int64) * QUARTERS
    target = np.where(points, (key - reach[0]) * QUARTERS, resting)
    begins, ends = (np.where(points, part[rows, key], FAR) for part in (wait, left))
    return np.stack(motion.step(hand[:, 0], hand[:, 1], target, begins, ends), axis=-1)
