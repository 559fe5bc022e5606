"""Where two outputs of the same tick differ first, bit by bit: NaN equals NaN of the same bits, 0.0 is not -0.0."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim.messages import PolicyStep, SessionHeader, TickOutput
from humanoid_sim.mit import COMMAND_FIELDS

__all__ = ["Difference", "first_difference"]

_UNSIGNED = {4: np.uint32, 8: np.uint64}


@dataclass(frozen=True, slots=True)
class Difference:
    """One value that is not what it was."""

    field: str
    """Of `TickOutput`, such as `command.position`."""
    where: str
    """The joint, or the index; empty for a field without parts."""
    recorded: str
    replayed: str

    def __str__(self) -> str:
        place = f" of {self.where}" if self.where else ""
        return f"{self.field}{place}: recorded {self.recorded}, replayed {self.replayed}"


def first_difference(header: SessionHeader, recorded: TickOutput, replayed: TickOutput) -> Difference | None:
    """The first field that differs, causes before consequences; None if the outputs are identical.

    `header` names the joints and the observation terms.
    """
    return next(_differences(header, recorded, replayed), None)


def _differences(header: SessionHeader, recorded: TickOutput, replayed: TickOutput) -> Iterator[Difference]:
    yield from _policy_steps(header, recorded.policy_step, replayed.policy_step)
    yield from _plain("faults", recorded.faults, replayed.faults)
    yield from _plain("policy_error", recorded.policy_error, replayed.policy_error)
    yield from _plain("refusals", recorded.refusals, replayed.refusals)
    before, now = recorded.control_mode, replayed.control_mode
    yield from _plain("control_mode.mode", before.mode.name, now.mode.name)
    yield from _plain("control_mode.controller_name", before.controller_name, now.controller_name)
    yield from _plain("control_mode.status_message", before.status_message, now.status_message)
    for name in COMMAND_FIELDS:
        arrays = getattr(recorded.command, name), getattr(replayed.command, name)
        yield from _arrays(f"command.{name}", *arrays, header.joint_names)
    yield from _standby(recorded, replayed)
    yield from _plain("quit", recorded.quit, replayed.quit)


def _policy_steps(
    header: SessionHeader, recorded: PolicyStep | None, replayed: PolicyStep | None
) -> Iterator[Difference]:
    if recorded is None or replayed is None:
        yield from _plain("policy_step", _presence(recorded), _presence(replayed))
        return
    yield from _plain("policy_step.frame", recorded.frame, replayed.frame)
    labels = tuple(f"{term}[{index}]" for term, width in header.observation_terms for index in range(width))
    yield from _arrays("policy_step.observation", recorded.observation, replayed.observation, labels)
    yield from _arrays("policy_step.action", recorded.action, replayed.action, ())


def _standby(recorded: TickOutput, replayed: TickOutput) -> Iterator[Difference]:
    before, now = recorded.standby, replayed.standby
    if before is None or now is None:
        yield from _plain("standby", _presence(before), _presence(now))
        return
    for name in ("current_segment", "total_segments", "is_finished"):
        yield from _plain(f"standby.{name}", getattr(before, name), getattr(now, name))
    if struct.pack("<d", before.progress) != struct.pack("<d", now.progress):
        yield Difference("standby.progress", "", *_shown(np.float64(before.progress), np.float64(now.progress)))


def _presence(value: object) -> str:
    return "none" if value is None else "one"


def _plain(field: str, recorded: object, replayed: object) -> Iterator[Difference]:
    """Values whose equality is exact: texts, integers, records of these."""
    if recorded != replayed:
        yield Difference(field, "", repr(recorded), repr(replayed))


def _arrays(
    field: str, recorded: npt.NDArray[Any], replayed: npt.NDArray[Any], labels: tuple[str, ...]
) -> Iterator[Difference]:
    if recorded.shape != replayed.shape:
        yield Difference(field, "", f"shape {recorded.shape}", f"shape {replayed.shape}")
    elif recorded.tobytes() != replayed.tobytes():
        bits = _UNSIGNED[recorded.itemsize]
        before, now = (np.ascontiguousarray(array).reshape(-1) for array in (recorded, replayed))
        index = int(np.argmax(before.view(bits) != now.view(bits)))
        where = labels[index] if index < len(labels) else f"[{index}]"
        yield Difference(field, where, *_shown(before[index], now[index]))


def _shown(recorded: np.floating[Any], replayed: np.floating[Any]) -> tuple[str, str]:
    """Both values, with their bits where the digits are the same."""
    texts = str(recorded), str(replayed)
    if texts[0] != texts[1]:
        return texts
    return f"{texts[0]} (bits {_bits(recorded)})", f"{texts[1]} (bits {_bits(replayed)})"


def _bits(value: np.floating[Any]) -> str:
    return f"0x{value.tobytes()[::-1].hex()}"
