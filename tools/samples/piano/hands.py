"""Abilities of the piano policy's hands, and the rule for what each does next.

A hand is over a key, on its bottom, or on a course between two such places, which it always ends: a stroke of the
open-loop player's, or one of the `Ways`. Each has the player's leads and takes as long as the motors need, so that the
arm is where it should be and is still when it strikes. Each policy step of each course is a row of commands of its own.
The last command says which row a hand is in, so the policy remembers nothing.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from humanoid_sim.evaluation.key_poses import ABOVE, PRESSED, KeyPoses
from humanoid_sim.evaluation.piano_player import APART, HOME, PianoPlayer, Timing
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.description import RobotDescription
from tools.samples.piano.ways import Ways

__all__ = ["FAR", "NONE", "POLICY_DT", "TIMING", "Motion", "Moves", "home", "moves_of", "ways_of"]

IntArray = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

POLICY_DT = 0.02
"""s"""
TIMING = Timing(press=0.14)
"""The player's, but a stroke is quicker."""
FAR = 1000.0
"""Steps that stand for never."""
NONE = 88
"""Stands for no key."""


@dataclass(frozen=True, slots=True, eq=False)
class Moves:
    """All that one hand can do: R rows, one a policy step."""

    command: FloatArray
    """Shape (R, 7), rad."""
    follows: IntArray
    """Shape (R,): the row after each, unless the hand begins something else."""
    origin: IntArray
    """Shape (R,): the key that it comes from, and"""
    key: IntArray
    """shape (R,): the one that it is over, or goes to."""
    busy: IntArray
    """Shape (R,): steps until it can do anything but follow."""
    depth: FloatArray
    """Shape (R,): 0 over a key, 1 on its bottom."""
    is_over: Flags
    """Shape (R,): whether it can press its key, or go to another."""
    is_down: Flags
    """Shape (R,): whether it is on the bottom of its key, which it can leave."""
    way: IntArray
    """Shape (K, K): the row in which a way from one of its keys to another begins; itself on the diagonal."""
    press: IntArray
    """Shape (K,): the row in which it begins to press a key, and"""
    release: IntArray
    """shape (K,): to release it."""
    over: IntArray
    """Shape (K,): the row in which it waits over a key."""

    @property
    def lowest(self) -> int:
        """The first of its K keys."""
        return int(self.key[self.over[0]])

    @property
    def highest(self) -> int:
        """The last of its K keys."""
        return int(self.key[self.over[-1]])


class _Rows:
    """Collects the rows of a hand."""

    def __init__(self) -> None:
        self.commands: list[FloatArray] = []
        self.rows: list[tuple[int, int, int, int, float, bool, bool]] = []

    def add(
        self,
        command: FloatArray,
        origin: int,
        key: int,
        follows: int | None = None,
        *,
        busy: int = 0,
        depth: float = 0.0,
        over: bool = False,
        down: bool = False,
    ) -> int:
        row = len(self.rows)
        self.commands.append(command)
        self.rows.append((row if follows is None else follows, origin, key, busy, depth, over, down))
        return row

    def course(self, commands: FloatArray, origin: int, key: int, then: int, depths: FloatArray) -> int:
        """Its first row; at its end a hand is free again."""
        first, last = len(self.rows), len(commands) - 1
        for step, command in enumerate(commands):
            free, down = step == last, depths[-1] == 1.0
            self.add(
                command,
                key if free else origin,
                key,
                then if free else first + step + 1,
                busy=last - step,
                depth=float(depths[step]),
                over=free and not down,
                down=free and down,
            )
        return first


def moves_of(ways: Ways, hand: int, keys: Collection[int] | None = None) -> Moves:
    """All that a hand can do; it takes a few seconds.

    Args:
        ways: of the robot, at `POLICY_DT`; the strokes are those of their player.
        hand: 0 is the left one.
        keys: next to each other, if not all that it reaches.
    """
    player, rows = ways.player, _Rows()
    poses = player.poses
    own = [key for key in poses.keys[hand] if keys is None or key in keys]
    above, pressed = poses.table[hand, ABOVE], poses.table[hand, PRESSED]
    over = {key: rows.add(above[key], key, key, over=True) for key in own}
    bottom = {key: rows.add(pressed[key], key, key, depth=1.0, down=True) for key in own}
    press, release = [], []
    for key in own:
        course = player.press(hand, key)[1:]
        press.append(rows.course(course, key, key, bottom[key], np.arange(1.0, len(course) + 1.0) / len(course)))
        course = ways.release(hand, key)  # from its start: without the lead the finger drags along the key
        release.append(rows.course(course, key, key, over[key], 1.0 - np.arange(len(course)) / (len(course) - 1.0)))
    way = np.empty((len(own), len(own)), dtype=np.int64)
    for i, origin in enumerate(own):
        for j, key in enumerate(own):
            if i == j:
                way[i, j] = over[key]
                continue
            course = ways(hand, origin, key)
            way[i, j] = rows.course(course, origin, key, over[key], np.zeros(len(course)))
    follows, origins, ends, busy, depth, is_over, is_down = (
        np.array(column) for column in zip(*rows.rows, strict=True)
    )
    return Moves(
        np.array(rows.commands),
        follows,
        origins,
        ends,
        busy,
        depth,
        is_over,
        is_down,
        way,
        np.array(press),
        np.array(release),
        np.array(list(over.values())),
    )


def home(moves: tuple[Moves, Moves]) -> IntArray:
    """Shape (2,): the row of each hand before the first step."""
    return np.array([own.over[HOME[hand] - own.lowest] for hand, own in enumerate(moves)])


@dataclass(frozen=True, slots=True)
class Motion:
    """The rule for what a hand does next, in policy steps of 20 ms."""

    sounds: int = 6
    """Steps before a note's start at which its key is pressed: so long it takes until it sounds."""
    stops: int = 1
    """Steps before a note's end at which its key is released."""
    repeats: int = 10
    """Steps before its key is asked for again at which it is released at the latest: so long it takes until it sounds
    once more."""
    apart: int = APART
    """Semitones that hands keep from each other."""

    def step(
        self,
        moves: tuple[Moves, Moves],
        rows: IntArray,
        pointed: IntArray,
        wait: FloatArray,
        left: FloatArray,
        again: FloatArray,
    ) -> IntArray:
        """Return the rows of both hands after a step; all arrays have the shape (S, 2).

        A hand goes to the key that it is pointed at, or as far as the other leaves room: where that is, where it goes
        to, and the key that it is pointed at, if its note begins first. Then it presses the key in time.

        Args:
            moves: of both hands.
            rows: that the hands are in.
            pointed: at which key each is pointed, `NONE` for none.
            wait: steps until the note of that key begins; 0 if it has begun.
            left: steps until it ends.
            again: steps until that key's next note begins.
        """
        points = pointed < NONE
        wait, left, again = (np.where(points, steps, FAR) for steps in (wait, left, again))
        here = np.stack([own.key[rows[:, hand]] for hand, own in enumerate(moves)], axis=-1)
        aim = np.where(points, pointed, here)
        aim = np.stack([np.clip(aim[:, hand], own.lowest, own.highest) for hand, own in enumerate(moves)], axis=-1)
        yields = np.stack([wait[:, 1] < wait[:, 0], wait[:, 0] <= wait[:, 1]], axis=-1)
        found = np.empty_like(rows)
        for hand, own in enumerate(moves):
            row, key, other = rows[:, hand], here[:, hand], 1 - hand
            comes_from, theirs = moves[other].origin[rows[:, other]], here[:, other]
            coming = np.where(yields[:, hand], aim[:, other], theirs)
            if hand == 0:
                room = np.minimum(np.minimum(comes_from, theirs), coming) - self.apart
                to = np.minimum(aim[:, hand], room)
            else:
                room = np.maximum(np.maximum(comes_from, theirs), coming) + self.apart
                to = np.maximum(aim[:, hand], room)
            to = np.clip(to, own.lowest, own.highest)
            lasts = points[:, hand] & (aim[:, hand] == key) & (left[:, hand] > self.stops)
            stays = lasts & (again[:, hand] > self.repeats)
            soon = np.where(again[:, hand] > self.repeats, wait[:, hand], again[:, hand])
            presses = lasts & (soon <= self.sounds)
            follows = own.follows[row]
            goes = np.where(
                to != key,
                own.way[key - own.lowest, to - own.lowest],
                np.where(presses, own.press[key - own.lowest], follows),
            )
            found[:, hand] = np.where(
                own.is_down[row],
                np.where(stays, follows, own.release[key - own.lowest]),
                np.where(own.is_over[row], goes, follows),
            )
        return found


def ways_of(description: RobotDescription, poses: KeyPoses) -> Ways:
    """Those that the policy's hands go."""
    return Ways(PianoPlayer(description, POLICY_DT, poses=poses, timing=TIMING), description, POLICY_DT)
