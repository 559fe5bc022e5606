"""Signs: whether the efforts that hold a robot at rest in STANDBY are those that gravity needs.

A motor whose direction is wrong reports and obeys the mirrored joint, so that no motion shows it. But the robot is then
in another pose than its readings say, and the joint's effort has the wrong sign; a wrong homing offset changes the pose
alone. What gravity needs under each of these faults follows from the levers of the measured pose, which enter the tick
as the live input `GRAVITY_LEVERS`. A fault is reported where the efforts contradict a sound robot by more than such a
robot may differ from its model, summed over all poses in which it rested.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from humanoid_sim.controllers.parameters import joint_tuple, per_joint_or_infinite, range_middle
from humanoid_sim.errors import FieldError, known_names
from humanoid_sim.mit import GRAVITY_LEVERS, BoolArray, FloatArray, IntArray, MITCommand, MITState, frozen_array

LEVER_COLUMNS = 10
"""Columns of the live input `GRAVITY_LEVERS`, one row per joint, at the measured pose; vectors in the world frame.

0 to 2: the joint's axis, a unit vector, or zeros where its effort is not gravity's alone. 3 to 5: N·m, the weight of
all that the joint carries times the vector from the joint to its centre of mass. 6: index of the next joint towards the
base, or -1. 7 and 8: N·m by which a sound robot's effort may be less, and more. 9: 1 where the joint's limb may stand
on the ground, else 0.
"""
UNDECIDED, AGREES, CONTRADICTS = range(3)
"""Verdicts. Undecided are joints that need little torque, limbs that stand on something, and joints not at rest."""

_AXIS, _MOMENT, _PARENT, _LESS, _MORE, _GROUND = slice(0, 3), slice(3, 6), 6, 7, 8, 9
_OFFSETS = (-0.8, -0.6, -0.4, -0.3, -0.2, -0.1, 0.1, 0.2, 0.3, 0.4, 0.6, 0.8)
"""rad: by how much a joint is off its reading, for each wrong homing offset that is considered."""
_MIRRORS = 2
"""A mirrored joint turns the other way round from its zero or, if it was calibrated like this, from its range's middle.
The latter is considered of joints that never stand: it would explain many a foot on the ground."""
_STEADY, _REST = 1e-4, 0.02
"""rad by which the command of a joint at rest, and its position, may change from one sample to the next."""
_STALE = 0.1
"""s after which a joint that is silent is not known to be at rest."""
_AT_STOP, _IMPOSSIBLE = 0.03, 0.1
"""rad: from this far before its limit on a joint's stop may carry what the motor does not; further out it cannot be."""
_ENOUGH = 2
"""Samples at rest for a verdict."""
_PATIENCE = 1.0
"""s after the end of the motion for which START waits for a verdict."""
_LEAST, _LEAST_STANDING = 0.01, 0.25
"""Misfit that counts, of limbs in the air and of those that may touch the ground."""
_EXPLAINED = 0.1
"""Share of a sound robot's misfit that may be left by what explains it."""


@dataclass(frozen=True, slots=True, eq=False)
class SignMemory:
    """Evidence since STANDBY began. A misfit is the square of what is beyond the tolerance, in tolerances."""

    time: float
    """s, robot's clock, of the latest sample."""
    position: FloatArray
    """Shape (n,), rad, of that sample."""
    command: FloatArray
    """Shape (n,), rad, likewise."""
    samples: FloatArray
    """Shape (n,): samples in which all that hangs on the base together with the joint was at rest."""
    sound: FloatArray
    """Shape (n,): misfit of the joint if the robot is sound, summed over them."""
    faulty: FloatArray
    """Shape (n, h): misfit of all that hangs together if the joint has fault h, likewise."""
    verdict: IntArray
    """Shape (n,): `UNDECIDED`, `AGREES` or `CONTRADICTS`."""
    finished_at: float | None = None
    """s, robot's clock, of the first sample after the end of the motion."""
    refusal: str = ""
    """Reason why START is refused; empty if it is not."""
    notice: str = ""
    """Message to the operator, one line."""

    @property
    def is_ready(self) -> bool:
        """True if there is a verdict, or it was waited for long enough."""
        waited = self.finished_at is not None and self.time - self.finished_at >= _PATIENCE
        return waited or bool(self.finished_at is not None and (self.samples >= _ENOUGH).all())


@dataclass(frozen=True, slots=True, eq=False)
class Signs:
    """The parameters, and one pure step."""

    joints: tuple[str, ...]
    lower: FloatArray
    """Shape (n,), rad, the joints' lower limits; -infinity for none."""
    upper: FloatArray
    """Shape (n,), rad, upper limits."""
    allowed: tuple[str, ...] = ()
    """Joints whose contradiction is only a warning: the operator knows better."""
    _mirrors: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        owner, put = "Signs", object.__setattr__
        put(self, "joints", joint_tuple(owner, self.joints))
        for name in ("lower", "upper"):
            put(self, name, per_joint_or_infinite(owner, name, getattr(self, name), self.joints))
        put(self, "allowed", joint_tuple(owner, self.allowed, "allowed", may_be_empty=True))
        for name in self.allowed:
            if name not in self.joints:
                raise FieldError(f"{owner}.allowed: {known_names('joint', name, self.joints)}")
        middle = range_middle(self.lower, self.upper)
        put(self, "_mirrors", frozen_array(owner, "_mirrors", np.stack([np.zeros(len(middle)), middle], axis=-1)))

    def watch(
        self, memory: SignMemory | None, state: MITState, command: MITCommand, *, is_finished: bool
    ) -> SignMemory | None:
        """One tick of STANDBY.

        Args:
            memory: of the previous tick; None where STANDBY begins.
            state: of this one, shape (n,), with `GRAVITY_LEVERS` in the ticks that are samples.
            command: that is about to leave, shape (n,).
            is_finished: the command has arrived at the final pose.

        Returns:
            What to remember; None as long as there was no sample.
        """
        live, n = state.extern.get(GRAVITY_LEVERS), len(self.joints)
        time, position = float(state.time), state.joint_position
        if live is None or live.arrival_time != time or live.value.shape != (n, LEVER_COLUMNS):
            return memory
        if not (
            np.isfinite(live.value).all() and np.isfinite(position).all() and np.isfinite(state.joint_effort).all()
        ):
            return memory
        none = np.zeros(n)
        if memory is None:
            faults = np.zeros((n, _MIRRORS + len(_OFFSETS)))
            start = np.full(n, np.inf)
            memory = SignMemory(time, start, start, none, none, faults, np.zeros(n, dtype=np.int64))
        tree = _Tree.of(live.value)
        is_still = (
            (np.abs(position - memory.position) <= _REST)
            & (np.abs(command.position - memory.command) <= _STEADY)
            & (state.joint_age < _STALE)
        )
        rests = ~(tree.together & ~is_still).any(axis=1)
        sound, faulty = self._misfits(tree, state) if rests.any() else (none, np.zeros_like(memory.faulty))
        # What stands on the ground is carried there: one leg alone that contradicts is at fault, several are loaded.
        suspect = tree.stands & (np.where(tree.together, sound, 0.0).sum(axis=1) > 0.0)
        loaded = suspect if len(np.unique(tree.root[suspect])) > 1 else np.zeros(n, dtype=bool)
        counts = rests & ~loaded
        samples = memory.samples + rests
        sound = memory.sound + np.where(counts, sound, 0.0)
        faulty = memory.faulty + np.where(counts[:, None], faulty, 0.0)
        finished_at = memory.finished_at
        if is_finished and finished_at is None:
            finished_at = time
        kept = time, position, command.position, samples, sound, faulty
        if not (samples >= _ENOUGH).any():
            return SignMemory(*kept, memory.verdict, finished_at)
        verdict, refusals, warnings = self._judge(tree, state, samples, sound, faulty)
        if loaded.any():
            names = ", ".join(self.joints[i] for i in np.unique(tree.root[loaded]))
            warnings.append(
                f"the limbs from {names} on contradict gravity at once, as feet on the ground do: "
                "lift the robot, or they cannot be judged"
            )
        agree = int((verdict == AGREES).sum())
        summary = f"signs: {agree} of {n} joints agree with gravity, {int((verdict == UNDECIDED).sum())} not decidable"
        refusal = "; ".join(refusals)
        notice = "; ".join([*refusals, summary, *warnings])
        ready = finished_at is not None and bool((samples >= _ENOUGH).all())
        return SignMemory(*kept, verdict, finished_at, refusal, notice if ready or refusal else memory.notice)

    def _judge(
        self, tree: _Tree, state: MITState, samples: FloatArray, sound: FloatArray, faulty: FloatArray
    ) -> tuple[IntArray, list[str], list[str]]:
        """Verdict of each joint, what refuses START, and what is only told."""
        count = np.maximum(samples, 1.0)
        sound, faulty = sound / count, faulty / count[:, None]
        least = np.where(tree.stands, _LEAST_STANDING, _LEAST)
        verdict = np.where((samples >= _ENOUGH) & (faulty[:, 0] > least), AGREES, UNDECIDED).astype(np.int64)
        refusals: list[str] = []
        warnings: list[str] = []
        for root in np.unique(tree.root):
            group = np.flatnonzero(tree.root == root)
            misfit = float(sound[group].sum())
            if samples[root] < _ENOUGH or misfit <= least[root]:
                continue
            verdict[group] = np.where(sound[group] > 0.0, UNDECIDED, verdict[group])
            flips, offsets = faulty[group, :_MIRRORS].min(axis=1), faulty[group, _MIRRORS:]
            row, column = np.unravel_index(offsets.argmin(), offsets.shape)
            flip, offset, shifted, by = flips.min(), offsets.min(), int(group[row]), -_OFFSETS[int(column)]
            enough = _EXPLAINED * misfit
            if flip <= enough and flip <= offset + 0.5 * enough:
                # Of those that explain it as well, first the joint that itself is held most wrongly.
                equal = group[flips <= flip + 0.5 * enough]
                flipped, *others = (int(joint) for joint in equal[np.argsort(-sound[equal], kind="stable")])
                verdict[flipped] = CONTRADICTS
                explanations = ["its direction explains that", *(f"that of {self.joints[i]} would too" for i in others)]
                if offset <= enough:
                    explanations.append(
                        f"a homing offset of {self.joints[shifted]} that is off by about {by:.1f} rad would too"
                    )
                text = f"{self._seen(tree, state, flipped)}; {', '.join(explanations)}"
                is_allowed = any(self.joints[i] in self.allowed for i in (flipped, *others))
                (warnings if is_allowed else refusals).append(text)
            elif offset <= enough:
                verdict[shifted] = CONTRADICTS
                seen = self._seen(tree, state, shifted)
                warnings.append(f"{seen}; a homing offset that is off by about {by:.1f} rad explains that")
            else:
                worst = int(group[sound[group].argmax()])
                warnings.append(
                    f"{self._seen(tree, state, worst)}; no single direction or offset explains that: "
                    "does it carry, touch or stand on something?"
                )
        return verdict, refusals, warnings

    def _seen(self, tree: _Tree, state: MITState, joint: int) -> str:
        needed = float(tree.own[joint])
        return (
            f"{self.joints[joint]} contradicts gravity: held with {state.joint_effort[joint]:.1f} N·m at "
            f"{state.joint_position[joint]:.2f} rad, where its readings need {needed:.1f}"
        )

    def _misfits(self, tree: _Tree, state: MITState) -> tuple[FloatArray, FloatArray]:
        """Misfits as `SignMemory` has them, of this sample: `sound`, shape (n,), and `faulty`, shape (n, h)."""
        n, position = len(self.joints), state.joint_position
        mirrors = 2.0 * (self._mirrors - position[:, None])
        turn = np.concatenate([mirrors, np.broadcast_to(_OFFSETS, (n, len(_OFFSETS)))], axis=1)
        sign = np.repeat([[-1.0, 1.0]], [_MIRRORS, len(_OFFSETS)], axis=1).repeat(n, axis=0)
        joint = np.repeat(np.arange(n), turn.shape[1])
        sound = self._misfit(tree, state, np.zeros(1, dtype=np.int64), np.zeros(1), np.ones(1))[0]
        apart = self._misfit(tree, state, joint, turn.ravel(), sign.ravel())
        faulty = np.where(tree.together[joint], apart, 0.0).sum(axis=1).reshape(turn.shape)
        faulty[tree.stands, 1:_MIRRORS] = np.inf
        return sound, faulty

    def _misfit(self, tree: _Tree, state: MITState, joint: IntArray, turn: FloatArray, sign: FloatArray) -> FloatArray:
        """Shape (h, n), of each joint if one, index (h,), is a turn (h,) off its reading, its effort of a sign (h,)."""
        rows = np.arange(len(joint))
        torque = tree.torque(joint, turn)
        effort, place = (np.broadcast_to(a, torque.shape).copy() for a in (state.joint_effort, state.joint_position))
        effort[rows, joint] *= sign
        place[rows, joint] += turn
        off = effort - torque
        off = np.where(place >= self.upper - _AT_STOP, np.minimum(off, 0.0), off)
        off = np.where(place <= self.lower + _AT_STOP, np.maximum(off, 0.0), off)
        beyond = np.maximum(off / tree.more, -off / tree.less) - 1.0
        misfit = np.square(np.maximum(beyond, 0.0)) * tree.axis.any(axis=1)
        placed = place[rows, joint]
        impossible = (placed > self.upper[joint] + _IMPOSSIBLE) | (placed < self.lower[joint] - _IMPOSSIBLE)
        misfit[rows[impossible], joint[impossible]] = np.inf
        return misfit


@dataclass(frozen=True, slots=True, eq=False)
class _Tree:
    """The joints as the levers have them."""

    axis: FloatArray
    """Shape (n, 3)."""
    moment: FloatArray
    """Shape (n, 3), N·m."""
    own: FloatArray
    """Shape (n,), N·m that hold the measured pose."""
    less: FloatArray
    """Shape (n,), N·m by which the effort may be less."""
    more: FloatArray
    """Shape (n,), N·m by which it may be more."""
    carries: BoolArray
    """Shape (n, n): the row's joint carries the column's, or is the same."""
    root: IntArray
    """Shape (n,): index of the joint next to the base."""
    together: BoolArray
    """Shape (n, n): both have the same root."""
    stands: BoolArray
    """Shape (n,): something that hangs together with it may stand on the ground."""

    @classmethod
    def of(cls, levers: FloatArray) -> _Tree:
        """From the live input's value."""
        n, parent = len(levers), levers[:, _PARENT].astype(np.int64)
        carries, root = np.eye(n, dtype=bool), np.arange(n)
        for joint in range(n):
            above = joint
            for _ in range(n):
                root[joint] = above
                above = int(parent[above])
                if not 0 <= above < n:
                    break
                carries[above, joint] = True
        together = root[:, None] == root
        axis, moment = levers[:, _AXIS], levers[:, _MOMENT]
        own = axis[:, 0] * moment[:, 1] - axis[:, 1] * moment[:, 0]
        stands = (together & (levers[:, _GROUND] > 0.0)).any(axis=1)
        return cls(axis, moment, own, levers[:, _LESS], levers[:, _MORE], carries, root, together, stands)

    def torque(self, joint: IntArray, turn: FloatArray) -> FloatArray:
        """Shape (h, n), N·m that hold the robot if a joint (h,) is a turn (h,), rad, further than its reading says.

        The holding torque is `axis · (moment x up)`. To what the joint carries, turning it is turning the vertical
        back; what carries it sees its centre of mass elsewhere.
        """
        axis = self.axis[joint]
        up = _rotated(np.broadcast_to([0.0, 0.0, 1.0], axis.shape), axis, -turn)
        moved = _rotated(self.moment[joint], axis, turn) - self.moment[joint]
        turned = (up[:, None] * np.cross(self.axis, self.moment)).sum(axis=-1)
        shifted = self.own + np.outer(moved[:, 1], self.axis[:, 0]) - np.outer(moved[:, 0], self.axis[:, 1])
        torque: FloatArray = np.where(
            self.carries[joint], turned, np.where(self.carries[:, joint].T, shifted, self.own)
        )
        return torque


def _rotated(vector: FloatArray, axis: FloatArray, angle: FloatArray) -> FloatArray:
    """Vectors (h, 3) about unit axes (h, 3) by angles (h,), rad: Rodrigues' formula."""
    cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
    along = (axis * vector).sum(axis=-1, keepdims=True)
    rotated: FloatArray = vector * cos + np.cross(axis, vector) * sin + axis * along * (1.0 - cos)
    return rotated
