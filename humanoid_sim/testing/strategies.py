"""Hypothesis strategies for all that may reach the control stack, broken values included; n is the number of joints.

"Any" holds NaN, infinities, huge and subnormal numbers; "healthy" and "valid" is what a working robot or sender gives.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from humanoid_sim.messages import Intent, RemoteCommand, SafetyFlag, SafetyLevel, SafetyStatus, TickInput
from humanoid_sim.mit import EXTERN_WIDTHS, Extern, FloatArray, MITCommand, MITState
from humanoid_sim.testing.healthy import healthy_state

_ODD_NUMBERS = [0.0, -0.0, 1.0, -1.0, 5e-324, 1e-300, 1e39, -1e39, 1e308, -1e308, np.inf, -np.inf, np.nan]
_ANY = st.sampled_from(_ODD_NUMBERS) | st.floats(-10.0, 10.0) | st.floats()
_MODERATE = st.floats(-3.0, 3.0, allow_subnormal=False)
_GAINS = st.floats(0.0, 100.0, allow_subnormal=False)
_DISTINCT = 5  # numbers drawn for one array, which a longer one repeats: what an example may draw is bounded
_EXTERN_NAMES = ("key_pressed", *EXTERN_WIDTHS, "unheard_of")
_JUMPS = [0.0, 0.02, 0.02, 0.1, 1.0, -0.02, -5.0, 1e6, -1e6, 1e300, np.nan, np.inf]  # s


@cache
def _arrays(n: int, numbers: SearchStrategy[float]) -> SearchStrategy[FloatArray]:
    drawn = min(n, _DISTINCT)
    return st.lists(numbers, min_size=drawn, max_size=drawn).map(lambda some: np.resize(np.array(some, float), n))


@cache
def any_arrays(n: int) -> SearchStrategy[FloatArray]:
    """Arrays of shape (n,): odd throughout, or with one odd value among moderate ones."""

    def with_one(i: int, odd: float, rest: float) -> FloatArray:
        array = np.full(n, rest)
        array[i] = odd
        return array

    throughout = _arrays(n, _ANY)
    return st.builds(with_one, st.integers(0, n - 1), _ANY, _MODERATE) | throughout if n else throughout


@cache
def any_externs() -> SearchStrategy[dict[str, Extern]]:
    """Live arrays of any width, age and timeout; often none."""
    timeouts = st.sampled_from([np.inf, 0.5, 0.0, -1.0, np.nan])
    extern = st.builds(Extern, st.integers(1, 7).flatmap(any_arrays), arrival_time=_ANY, timeout=timeouts)
    return st.dictionaries(st.sampled_from(_EXTERN_NAMES), extern, max_size=2)


def any_states(n: int, time: float) -> SearchStrategy[MITState]:
    """States of any content at `time` s: joints never received, impossible quaternions, infinite ages."""
    return st.builds(
        MITState,
        time=st.just(time),
        joint_position=any_arrays(n) | st.just(np.full(n, np.nan)),
        joint_velocity=any_arrays(n),
        joint_effort=any_arrays(n),
        joint_age=any_arrays(n),
        imu_quaternion=any_arrays(4),
        imu_angular_velocity=any_arrays(3),
        imu_linear_acceleration=any_arrays(3),
        extern=any_externs(),
    )


def healthy_states(n: int, time: float, extern: Mapping[str, Extern] | None = None) -> SearchStrategy[MITState]:
    """States of an upright robot whose joints are all known and move, at `time` s, with the live inputs `extern`."""

    def state(position: FloatArray, velocity: FloatArray, effort: FloatArray) -> MITState:
        rest = replace(healthy_state(position, time), extern=extern or {})
        return replace(rest, joint_velocity=velocity, joint_effort=effort)

    return st.builds(state, *[_arrays(n, _MODERATE)] * 3)


@cache
def clock_jumps() -> SearchStrategy[float]:
    """Seconds from one tick to the next of an unreliable clock: backwards, years ahead, not a number."""
    return st.sampled_from(_JUMPS) | st.floats(-1, 1)


SAFETY_STATUSES: SearchStrategy[tuple[SafetyStatus, ...]] = st.lists(
    st.builds(
        SafetyStatus,
        level=st.sampled_from(SafetyLevel),
        flags=st.sampled_from(SafetyFlag) | st.integers(0, 2**32 - 1),  # bits without a name too
        source=st.sampled_from(["", "can0", "can1", "simulator"]),
        message=st.sampled_from(["", "left_elbow over-current"]),
    ),
    max_size=3,
).map(tuple)
INTENTS: SearchStrategy[tuple[Intent, ...]] = st.lists(st.sampled_from(Intent), max_size=3).map(tuple)


@cache
def any_commands(n: int) -> SearchStrategy[MITCommand]:
    """Commands of any content: negative gains, NaN."""
    return st.builds(MITCommand, *[any_arrays(n)] * 5)


@cache
def valid_commands(n: int) -> SearchStrategy[MITCommand]:
    """Finite commands with gains that are not negative."""
    return st.builds(MITCommand, *[_arrays(n, _MODERATE)] * 3, *[_arrays(n, _GAINS)] * 2)


def any_tick_inputs(n: int, time: float) -> SearchStrategy[TickInput]:
    """Everything at once, at `time` s, with remote commands that are valid, broken or wrongly sized."""
    commands = valid_commands(n) | any_commands(n) | valid_commands(n + 1)
    stamps = st.sampled_from([time, time - 0.05, time - 1.0, time + 0.01, time + 100.0]) | _ANY
    return st.builds(
        TickInput,
        state=any_states(n, time),
        safety=SAFETY_STATUSES,
        intents=INTENTS,
        remote=st.none() | st.builds(RemoteCommand, commands, stamps),
        policy=st.sampled_from(["", "unheard_of"]),
    )
