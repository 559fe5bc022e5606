"""A song played open loop: inverse kinematics says how to strike each key, a plan which hand takes which note.

What a piano policy is measured against, and what it learns from. It hears nothing: the commands follow from the goals.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from humanoid_sim.evaluation.key_poses import ABOVE, LIFTED, MIXED, PRESSED, READY, KeyPoses, Mixture, pose_number
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.piano import KEY_COUNT
from humanoid_sim.simulation.fingers import HANDS
from humanoid_sim.simulation.kinematics import MassMatrix

IntArray = npt.NDArray[np.intp]
_Share = TypeVar("_Share", float, FloatArray)
Course = FloatArray
"""The commands of one arm from a key to another, or down or up: shape (steps + 1, 7), rad, one row a policy step."""

HORIZON = 1.2
"""s ahead that the player looks."""


@dataclass(frozen=True, slots=True)
class Goal:
    """One note, in policy steps."""

    key: int
    start: int
    """The first step in which the key should be down."""
    end: int
    """The first in which it should not."""


def goals_of(table: npt.NDArray[np.floating]) -> list[Goal]:
    """Return the notes of a table of goals, shape (F, 88), 0 or 1, in order of their start."""
    down = np.zeros((len(table) + 2, table.shape[1]), dtype=np.int8)
    down[1:-1] = table > 0.5
    change = np.diff(down, axis=0)
    goals = []
    for key in np.flatnonzero(down.any(axis=0)).tolist():
        starts, ends = np.flatnonzero(change[:, key] == 1), np.flatnonzero(change[:, key] == -1)
        goals += [Goal(key, int(start), int(end)) for start, end in zip(starts, ends, strict=True)]
    return sorted(goals, key=lambda goal: (goal.start, goal.key))


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Between which poses each hand is in each step."""

    number: IntArray
    """Shape (F, 2, `MIXED`), of `KeyPoses.numbered`."""
    share: FloatArray
    """Shape (F, 2, `MIXED`), of each; they add up to 1."""


@dataclass(frozen=True, slots=True)
class Timing:
    """Durations, in s."""

    press: float = 0.18
    """From over a key until it is down."""
    sounds: float = 0.14
    """From the beginning of that until the key sounds."""
    release: float = 0.06
    """From the bottom of a key to over it."""
    stops: float = 0.02
    """From the beginning of that until the key stops."""
    travel: float = 0.07
    """Least time of the way to another key, and"""
    per_key: float = 0.0075
    """beyond it for each semitone."""
    settle: float = 0.04
    """After that, until the arm is still."""


@dataclass(slots=True, eq=False)
class _Hand:
    """Place of a hand, and its way."""

    side: int
    key: int
    """Over which it is, or will be."""
    place: Mixture
    down: bool = False
    strokes: bool = False
    """True if its way is down to, or up from, a key."""
    start: int | None = None
    """The pose where its present way began; None while it rests."""
    origin: int = -1
    """The key over which it began."""
    step: int = 0
    steps: int = 0
    settling: int = 0
    """Steps that are left until it may strike."""

    @property
    def keys(self) -> tuple[int, ...]:
        """Over which it is: while it is on its way both ends."""
        return (self.key,) if self.start is None else (self.origin, self.key)


class PianoPlayer:
    """Plays songs with the two hands of a robot; it remembers nothing between songs."""

    def __init__(
        self,
        description: RobotDescription,
        policy_dt: float,
        *,
        poses: KeyPoses | None = None,
        timing: Timing = Timing(),
    ) -> None:
        """Prepare for a robot with a piano and commands `policy_dt` s apart; its poses are found unless given."""
        self.poses = KeyPoses.of(description) if poses is None else poses
        self._numbered = self.poses.numbered
        self._lower, self._upper = description.lower, description.upper
        self._stiffness, self._damping = description.stiffness, description.damping
        self._mass = MassMatrix(description)
        self._timing, self._dt = timing, policy_dt
        self._press, self._sounds, self._release, self._stops, self._settle = (
            max(round(value / policy_dt), 1)
            for value in (timing.press, timing.sounds, timing.release, timing.stops, timing.settle)
        )
        self._horizon = round(HORIZON / policy_dt)

    def play(self, table: npt.NDArray[np.floating]) -> FloatArray:
        """Return the commands of a song, shape (F, n), rad, by the goals at each step, shape (F, 88), 0 or 1.

        They lead the planned poses by what the MIT law takes to follow them: `q + (K_d q' + M q'') / K_p`.
        """
        return self.led(self.poses_of(self.plan(table)))

    def led(self, planned: FloatArray) -> FloatArray:
        """Return the commands that servos need to be in planned poses in time, shape (F, n), rad.

        The poses are likewise, one row a policy step, with what the servos sag; the robot is at rest before and after.
        """
        padded = np.concatenate([planned[:1], planned, planned[-1:]])
        velocity = (padded[2:] - padded[:-2]) / (2.0 * self._dt)
        acceleration = (padded[2:] - 2.0 * planned + padded[:-2]) / self._dt**2
        lead = self._damping * velocity
        for frame in np.flatnonzero(acceleration.any(axis=1)).tolist():
            lead[frame] += self._mass(planned[frame]) @ acceleration[frame]
        commands: FloatArray = np.clip(planned + lead / self._stiffness, self._lower, self._upper)
        return commands

    def way_steps(self, origin: int, key: int) -> int:
        """Return how many the player needs from over one key to over another."""
        return max(self._way(origin, key), self._release)

    def press(self, side: int, key: int) -> Course:
        """Return how a hand over a key presses it."""
        hand = _Hand(side, key, {pose_number(ABOVE, key): 1.0})
        self._begin(hand, key, down=True, steps=self._press)
        return self._course(hand)

    def release(self, side: int, key: int, steps: int = 0) -> Course:
        """Return how a hand on a key releases it, in so many steps if the player's are fewer."""
        hand = _Hand(side, key, {pose_number(PRESSED, key): 1.0}, down=True)
        self._begin(hand, key, down=False, steps=max(self._release, steps))
        return self._course(hand)

    def _course(self, hand: _Hand) -> Course:
        """Return the commands of a hand from where it is to the end of its way, the other arm at rest."""
        places = [hand.place]
        while hand.start is not None:
            self._move(hand)
            places.append(hand.place)
        planned = np.empty((len(places), len(self._lower)))
        for side, arm in enumerate(self.poses.arms):
            planned[:, arm] = self.poses.ready[side]
        arm = self.poses.arms[hand.side]
        numbered = self._numbered[hand.side]
        for step, place in enumerate(places):
            planned[step, arm] = sum(share * numbered[number] for number, share in place.items())
        return self.led(planned)[:, arm]

    def poses_of(self, plan: Plan) -> FloatArray:
        """Shape (F, n), rad: a plan's poses, with what their servos sag added."""
        planned = np.empty((len(plan.number), len(self._lower)))
        for hand, arm in enumerate(self.poses.arms):
            mixed = self._numbered[hand][plan.number[:, hand]] * plan.share[:, hand, :, None]
            planned[:, arm] = mixed.sum(axis=1)
        return planned

    def plan(self, table: npt.NDArray[np.floating]) -> Plan:
        """Return where the hands should be; arguments as of `play`."""
        goals = goals_of(table)
        owner: Mapping[Goal, int] = {}
        hands = [_Hand(i, HOME[i], {READY: 1.0}) for i in range(len(HANDS))]
        number = np.zeros((len(table), len(HANDS), MIXED), dtype=np.intp)
        share = np.zeros((len(table), len(HANDS), MIXED))
        known = 0
        for frame in range(len(table)):
            seen = known
            while known < len(goals) and goals[known].start <= frame + self._horizon:
                known += 1
            coming = [goal for goal in goals[:known] if goal.end > frame]
            if known > seen:
                owner = self._assign(frame, coming, owner, hands)
            own = [[goal for goal in coming if owner.get(goal) == hand.side] for hand in hands]
            for hand in hands:
                if hand.start is None:
                    self._decide(frame, hand, own[hand.side], own[1 - hand.side], hands[1 - hand.side])
                self._move(hand)
                number[frame, hand.side, : len(hand.place)] = list(hand.place)
                share[frame, hand.side, : len(hand.place)] = list(hand.place.values())
        return Plan(number, share)

    def _move(self, hand: _Hand) -> None:
        """One step along the present way: at rest at both ends, lifted in between where it leads to another key."""
        if hand.start is None:
            return
        hand.step += 1
        share = smooth(hand.step / hand.steps)
        if hand.strokes:
            if hand.down:
                share = _gentle(hand.step / hand.steps, float(self.poses.touch[hand.key]))
            hand.place = self.poses.stroke(hand.key, share if hand.down else 1.0 - share)
        else:
            way = abs(hand.key - hand.origin)
            # Up to the line on which hands are lifted, and down from there: between far poses lies no straight way.
            near = min(max(0.5 + (share - 0.5) * max(way / (2.0 * _LIFTED), 1.0), 0.0), 1.0)
            lift = smooth(min(min(share, 1.0 - share) * way / _LIFTED, 1.0))
            along = hand.origin + share * (hand.key - hand.origin)
            low = min(int(along), KEY_COUNT - 2)
            hand.place = dict.fromkeys((hand.start, pose_number(ABOVE, hand.key)), 0.0)
            hand.place[hand.start] += (1.0 - lift) * (1.0 - near)
            hand.place[pose_number(ABOVE, hand.key)] += (1.0 - lift) * near
            for key, part in ((low, 1.0 - along + low), (low + 1, along - low)):
                hand.place[pose_number(LIFTED, key)] = lift * part
            hand.place = {number: part for number, part in hand.place.items() if part}
        if hand.step >= hand.steps:
            hand.settling = self._settle if hand.origin != hand.key else 0
            hand.start, hand.origin = None, hand.key

    def _begin(self, hand: _Hand, key: int, *, down: bool, steps: int) -> None:
        hand.strokes = down or hand.down
        (hand.start,) = hand.place
        hand.origin, hand.key, hand.down = hand.key, key, down
        hand.step, hand.steps = 0, steps

    def _decide(self, frame: int, hand: _Hand, own: Sequence[Goal], others: Sequence[Goal], other: _Hand) -> None:
        """Decide what a hand at rest does next, for its notes, or out of the other's way."""
        own = [goal for goal in own if goal.key in self.poses.keys[hand.side]]
        while own and own[0].start <= frame and self._end(own) - frame <= self._stops:
            own = own[1:]
        if hand.down:
            if not (own and own[0].key == hand.key and own[0].start - frame <= self._sounds):
                self._begin(hand, hand.key, down=False, steps=self._release)
        elif own and own[0].key == hand.key and hand.place == {pose_number(ABOVE, hand.key): 1.0}:
            hand.settling = max(hand.settling - 1, 0)
            if own[0].start - frame <= self._sounds and not hand.settling:
                self._begin(hand, hand.key, down=True, steps=self._press)
        else:
            goes = bool(own) and _is_clear(hand.side, own[0].key, other.keys) and not _gives_way(hand.side, own, others)
            key = own[0].key if goes else self._aside(hand, others, other)
            if key != hand.key or hand.place == {READY: 1.0}:
                self._begin(hand, key, down=False, steps=self.way_steps(hand.key, key))

    def _way(self, a: int, b: int) -> int:
        """Return steps from over one key to over another."""
        return 0 if a == b else round((self._timing.travel + self._timing.per_key * abs(a - b)) / self._dt)

    def _needed(self, a: int, b: int) -> int:
        """Return steps from over one key until another sounds."""
        return self._sounds + (self._way(a, b) + self._settle - 1 if a != b else 0)

    def _assign(
        self, frame: int, coming: Sequence[Goal], owner: Mapping[Goal, int], hands: Sequence[_Hand]
    ) -> Mapping[Goal, int]:
        """Return the hand of each note: those that are near keep theirs, the cheapest choice for the others."""
        near = {goal: owner[goal] for goal in coming if goal in owner and goal.start - frame < self._horizon // 2}
        free = [goal for goal in coming if goal not in near][:_CHOSEN]
        best, cheapest = dict(near), np.inf
        for choice in product(range(len(HANDS)), repeat=len(free)):
            owners = {**near, **dict(zip(free, choice, strict=True))}
            cost = self._cost(frame, owners, hands)
            if cost < cheapest:
                best, cheapest = owners, cost
        return best

    def _cost(self, frame: int, owners: Mapping[Goal, int], hands: Sequence[_Hand]) -> float:
        cost = 0.0
        of_hand = [sorted((g for g, h in owners.items() if h == hand), key=lambda g: g.start) for hand in range(2)]
        for hand, goals in enumerate(of_hand):
            key, free = hands[hand].key, frame
            for goal in goals:
                if goal.key not in self.poses.keys[hand]:
                    cost += _IMPOSSIBLE
                    continue
                if goal.start > frame or key != goal.key:
                    late = self._release - self._stops + self._needed(key, goal.key) - (goal.start - free)
                    cost += _LATE * max(late, 0)
                cost += _WAY * abs(goal.key - key) + _COMFORT * abs(goal.key - HOME[hand])
                key, free = goal.key, goal.end
        for left in of_hand[0]:
            for right in of_hand[1]:
                apart = max(left.start - right.end, right.start - left.end)
                if right.key - left.key < APART and apart < _CLEAR:
                    cost += _CROSSED if apart < 0 else 0.2 * _CROSSED
        return cost

    def _end(self, own: Sequence[Goal]) -> int:
        """Return when the first note of a hand ends, or sooner, if the hand has to be elsewhere by then."""
        goal = own[0]
        if len(own) < 2:
            return goal.end
        needed = self._release - self._stops + self._needed(goal.key, own[1].key)
        soonest = max(goal.end - _CUT, (goal.start + goal.end) // 2)
        return max(min(goal.end, own[1].start - needed), soonest)

    def _aside(self, hand: _Hand, others: Sequence[Goal], other: _Hand) -> int:
        """Return where a hand with nothing to do waits: where it is, out of the other's way."""
        keys = self.poses.keys[hand.side]
        taken = [*other.keys, *(goal.key for goal in others[:1])]
        away = min(hand.key, min(taken) - APART) if hand.side == 0 else max(hand.key, max(taken) + APART)
        return min(max(away, keys[0]), keys[-1])


def _is_clear(side: int, key: int, keys: Collection[int]) -> bool:
    """Return whether a hand over a key keeps away from the other one."""
    return key <= min(keys) - APART if side == 0 else key >= max(keys) + APART


def _gives_way(side: int, own: Sequence[Goal], others: Sequence[Goal]) -> bool:
    """Return whether the other hand's next note comes first, and this one's would be in its way."""
    return bool(others) and others[0].start < own[0].start and not _is_clear(side, own[0].key, [others[0].key])


def smooth(share: _Share) -> _Share:
    """From 0 to 1 with neither speed nor acceleration at the ends: least jerk (Flash and Hogan 1985)."""
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


def _gentle(time: float, touch: float) -> float:
    """Give the share of a stroke's way at a share of its time: the finger is almost still where it touches the key."""
    if time < _APPROACH:
        return touch * smooth(time / _APPROACH)
    return touch + (1.0 - touch) * smooth((time - _APPROACH) / (1.0 - _APPROACH))


HOME = 30, 57
"""The key over which each hand is at home."""
APART = 5
"""Semitones that hands keep from each other."""
_APPROACH = 0.5
"""Share of a stroke's time until the finger touches the key."""
_LIFTED = 4.0
"""Semitones within which a hand rises to where hands are lifted, and comes down again."""
_CHOSEN = 6
"""Notes whose hands are chosen at a time."""
_CLEAR = 12
"""Steps in which a hand gets out of the other's way."""
_CUT = 5
"""Steps by which a note ends sooner, at most."""
_IMPOSSIBLE, _CROSSED, _LATE, _WAY, _COMFORT = 1e4, 100.0, 1.0, 0.02, 0.02
