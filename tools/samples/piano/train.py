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
from tools.samples import TrainPianoConfig
from tools.samples.piano.export import export_piano_policy
from tools.samples.piano.hands import FAR, NONE, POLICY_DT, TIMING, Motion, Moves, home, moves_of, ways_of
from tools.samples.piano.pointer import OFFSETS, Pointer, key_features, times

__all__ = ["hands_of_notes", "train_piano"]

_SECONDS = 14.0
_CANDIDATES = 8
"""Keys that are looked at while training, the soonest; no song asks for more."""
_BATCH = 2048
_SOUNDS = 0.85
"""Depth from which on a key is taken for down while training."""
_READY = 0.2
"""s from the end of a note to the start of the next of the same hand, on another key, at least, beside the way."""
_BESIDE = 0.3
"""s after its last note for which a hand is in the other's way."""
_IMPOSSIBLE, _CROSSED, _LATE = 1e5, 1e3, 200.0
"""Costs, in semitones of way, where a hand cannot reach a key, is beyond the other, is late by a second."""
_PRACTICE = Motion(sounds=7, stops=2)
"""Motion of the hands in training: a step sooner than the exported policy's, so that they learn to be early."""
_CUT = 12
"""Steps by which a note ends sooner at most, for its hand to be in time for the next."""


@dataclass(frozen=True, slots=True, eq=False)
class _Lesson:
    """Songs side by side: what is seen, and where each hand should go."""

    wait: npt.NDArray[np.int16]
    """Shape (S, F, 88), steps."""
    left: npt.NDArray[np.int16]
    again: npt.NDArray[np.int16]
    target: npt.NDArray[np.int64]
    """Shape (S, F, 2): the key of each hand's next note, -1 for none."""


def train_piano(config: TrainPianoConfig) -> int:
    """Train as the options say, and write the policy; the exit status."""
    output = Path(config.output)
    torch.manual_seed(config.seed)
    torch.set_num_threads(1)  # more are little faster, and sum in another order
    rng = np.random.default_rng(config.seed)
    description = load_robot("lite_piano")
    ways = ways_of(description, KeyPoses.of(description))
    moves = moves_of(ways, 0), moves_of(ways, 1)
    network, motion = Pointer(), _PRACTICE
    lesson = _lesson(description, rng, config.songs, moves, motion)
    collected: list[tuple[FloatArray, FloatArray, npt.NDArray[np.int64]]] = []
    optimiser = torch.optim.Adam(network.parameters(), lr=2e-3)
    for number in range(config.rounds):
        collected.append(_walk(lesson, moves, motion, network if number else None, rng))
        features, asked, target = (np.concatenate(part) for part in zip(*collected, strict=True))
        x, mask = torch.from_numpy(features.astype(np.float32)), torch.from_numpy(asked.astype(np.float32))
        y = torch.from_numpy(target)
        for epoch in range(config.epochs):
            for group in optimiser.param_groups:
                group["lr"] = 2e-3 * (0.3 if number + 1 == config.rounds and epoch + 1 == config.epochs else 1.0)
            loss, right = _epoch(network, optimiser, x, mask, y)
            print(f"round {number + 1}, epoch {epoch + 1}: loss {loss:.4f}, {100.0 * right:.2f} % right", flush=True)
    weights = {name: value.detach().numpy() for name, value in network.state_dict().items()}
    export_piano_policy(output, weights, moves, ways.player.poses.arms, description, Motion())
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


def _lesson(
    description: RobotDescription, rng: np.random.Generator, count: int, moves: tuple[Moves, Moves], motion: Motion
) -> _Lesson:
    assert description.piano is not None
    hands = description.piano.hands
    frames = round(_SECONDS / POLICY_DT) + 2
    wait, left, again = (np.empty((count, frames, 88), dtype=np.int16) for _ in range(3))
    target = np.full((count, frames, 2), -1, dtype=np.int64)
    for i in range(count):
        song = random_song(rng, hands, seconds=_SECONDS, lead_in=float(rng.uniform(0.5, 1.2)))
        table = np.zeros((frames, 88))
        rows = goals(song, POLICY_DT)[:frames]
        table[: len(rows)] = rows
        seen = table[np.minimum(np.arange(frames)[:, None] + OFFSETS.astype(int), frames - 1)]
        wait[i], left[i], again[i] = times(seen)
        for hand, own in enumerate(hands_of_notes(song, hands)):
            target[i, :, hand] = _targets(own, frames, moves[hand], motion)
    return _Lesson(wait, left, again, target)


def hands_of_notes(song: Song, reach: Sequence[Collection[int]]) -> tuple[list[Note], list[Note]]:
    """Return the notes that each hand takes: of two at a time the lower is the left hand's, and else the nearer hand's.

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
            cost += way + _LATE * max(_READY + TIMING.travel + TIMING.per_key * way - (note.start - free[hand]), 0.0)
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


def _targets(own: Sequence[Note], frames: int, moves: Moves, motion: Motion) -> npt.NDArray[np.int64]:
    """Get the key of the note that a hand should be at or on its way to, shape (F,); it leaves in time for the next."""
    found = np.full(frames, -1, dtype=np.int64)
    frame = 0
    for note, following in zip(own, [*own[1:], None], strict=True):
        start, end = round(note.start / POLICY_DT), round(note.end / POLICY_DT)
        leaves = max(end - motion.stops, start + 1)
        if following is not None:
            needed = _needed(note.key, following.key, moves, motion)
            must = round(following.start / POLICY_DT) - needed
            leaves = min(leaves, max(must, (start + end) // 2, end - _CUT))
        first = max(frame, start - int(OFFSETS[-1]))
        frame = max(frame, leaves)
        found[first:frame] = note.key
    return found


def _needed(key: int, following: int, moves: Moves, motion: Motion) -> int:
    """Return steps from when a hand begins to leave a key until it sounds the next."""
    a, b = (min(max(k, moves.lowest), moves.highest) - moves.lowest for k in (key, following))
    way = 0 if a == b else int(moves.busy[moves.way[a, b]]) + 1
    return int(moves.busy[moves.release[a]]) + 1 + way + motion.sounds


def _walk(
    lesson: _Lesson, moves: tuple[Moves, Moves], motion: Motion, network: Pointer | None, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, npt.NDArray[np.int64]]:
    """Go through all songs at once, led by the lesson, or by the network; what was seen, and what would be right.

    Returns:
        Features (M, C, FEATURES), asked (M, C), and right answers (M, 2): a candidate, or C for none.
    """
    count, frames = lesson.wait.shape[:2]
    hands = np.tile(home(moves), (count, 1))
    rows = np.arange(count)
    found: list[tuple[FloatArray, FloatArray, npt.NDArray[np.int64]]] = []
    for frame in range(frames):
        wait, left, again = (part[:, frame].astype(np.float64) for part in (lesson.wait, lesson.left, lesson.again))
        states = np.stack(
            [
                np.stack([own.key[hands[:, i]], own.busy[hands[:, i]], own.depth[hands[:, i]]], axis=-1)
                for i, own in enumerate(moves)
            ],
            axis=1,
        ).astype(np.float64)
        pressed = np.zeros((count, 88))
        for hand in (0, 1):
            key = states[:, hand, 0].astype(int)
            pressed[rows, key] = np.maximum(pressed[rows, key], states[:, hand, 2] >= _SOUNDS)
        features = key_features(wait, left, again, pressed, states)
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
            strays = rng.random((count, 2)) < 0.05
            for hand, own in enumerate(moves):
                strayed = own.over[rng.integers(len(own.over), size=count)]
                hands[:, hand] = np.where(strays[:, hand] & ~own.is_down[hands[:, hand]], strayed, hands[:, hand])
        pointed = np.where(answer < _CANDIDATES, soonest[rows[:, None], np.minimum(answer, _CANDIDATES - 1)], NONE)
        song = (part[rows[:, None], np.minimum(pointed, NONE - 1)] for part in (wait, left, again))
        hands = motion.step(moves, hands, pointed, *song)
    features_all, asked_all, right_all = zip(*found, strict=True)
    return np.concatenate(features_all), np.concatenate(asked_all), np.concatenate(right_all)
