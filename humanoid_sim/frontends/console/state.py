"""State of a session for its pages, as JSON: pure functions of ticks."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from humanoid_sim.controllers.fsm import RULES, describe_safety, merge_safety, transition
from humanoid_sim.controllers.rotation import rotate
from humanoid_sim.controllers.supervisor import Supervisor
from humanoid_sim.evaluation.failure import describe_fall, has_fallen
from humanoid_sim.messages import Intent, SafetyFlag, SafetyStatus, SessionHeader, TickRecord
from humanoid_sim.mit import BASE_LINEAR_VELOCITY, FloatArray
from humanoid_sim.session.reactivation import REACTIVATE, reactivation_refusal
from humanoid_sim.simulation.floating_base import BaseObserver
from humanoid_sim.stack import no_policy, rebuild_supervisor

FLAG_MEANINGS: Mapping[SafetyFlag, str] = MappingProxyType(
    {
        SafetyFlag.BUS_OFF: "a CAN interface has left its bus after too many errors",
        SafetyFlag.RX_TIMEOUT: "a motor, or a sensor, has not been heard in time",
        SafetyFlag.TX_QUEUE_OVERRUN: "commands could not be sent: the interface's queue is full",
        SafetyFlag.MOTOR_FAULT: "a motor reports a fault, or is not enabled",
        SafetyFlag.TEMPERATURE_LIMIT: "a motor is too hot",
        SafetyFlag.INVALID_FRAME: "a frame or a value arrived that cannot be right",
    }
)


_ELSEWHERE = '{"remote": false, "action_limit": 100.0, "guards": false}'
"""Controllers of a robot that is only watched, whose session is elsewhere."""
_AFRESH = "checks and enables the motors afresh; starts at ZERO_TORQUE"
"""Note on the page's button REACTIVATE, which is not an intent's."""
_ANEW = "puts the simulated robot back to its start, in ZERO_TORQUE"
"""Note on the same button in a simulation."""


class Reasons:
    """Tells why the robot does what it does, and whether it has fallen; takes every tick."""

    def __init__(self, observer: BaseObserver | None) -> None:
        """Know of no tick; `observer` sees the floating base of a simulated robot, None for a fixed base."""
        self._observer = observer
        self._message = self._reason = ""
        self._is_free: bool | None = None
        self._standing_height = 0.0

    def look(self, record: TickRecord) -> None:
        """Keep the latest reason: a refusal changes nothing, so it is not one."""
        control = record.output.control_mode
        if control.status_message != self._message:
            self._message = said = control.status_message
            for refusal in record.output.refusals:
                said = said.replace(refusal, "")
            self._reason = "; ".join(part for part in said.split("; ") if part) or self._reason
        if self._observer is not None and record.qpos is not None and control.mode.is_free is not self._is_free:
            self._is_free = control.mode.is_free
            self._standing_height = self._observer.standing_height(record.qpos)

    def told(self, record: TickRecord) -> dict[str, str]:
        """Return the reason, and how the robot has fallen, empty if it has not; `record` is the newest tick."""
        fallen = ""
        if self._observer is not None and record.qpos is not None:
            base = self._observer.at(record.qpos, None)
            if has_fallen(base, self._standing_height):
                fallen = describe_fall(base, self._standing_height)
        return {"reason": self._reason, "fallen": fallen}


class LoopRate:
    """Measures the ticks per second of wall time, once a second."""

    value = math.nan
    """1/s; NaN while it is not known."""

    def __init__(self) -> None:
        self._number = self._stamp = 0

    def look(self, number: int, stamp: int) -> None:
        """Take the newest tick: its number, and when it was published, ns."""
        if stamp - self._stamp < 1_000_000_000:
            return
        if self._stamp:
            self.value = 1e9 * (number - self._number) / (stamp - self._stamp)
        self._number, self._stamp = number, stamp


def base_velocity(record: TickRecord, observer: BaseObserver | None) -> FloatArray:
    """Shape (3,), measured: m/s forward and to the left of the base's heading, and the yaw rate; NaN is not known."""
    state = record.input.state
    if observer is not None and record.qpos is not None and BASE_LINEAR_VELOCITY in state.extern:
        return observer.sensed(state, record.qpos).planar_velocity
    return np.array([np.nan, np.nan, rotate(state.imu_quaternion, state.imu_angular_velocity)[2]])


def known_supervisor(header: SessionHeader) -> Supervisor:
    """Return a session's control stack, with nothing in the place of its policy. Raises `InputError` if damaged."""
    return rebuild_supervisor(replace(header, documents={"controllers": _ELSEWHERE, **header.documents}), no_policy)


def refusals(record: TickRecord, supervisor: Supervisor) -> dict[Intent, str]:
    """Say why each intent would be refused after a tick; empty where it would be granted. The session decides."""
    control, standby = record.output.control_mode, record.output.standby
    safety, available = merge_safety(record.input.safety), supervisor.controllers
    is_finished = standby is not None and standby.is_finished
    found = {}
    for intent in RULES:
        unready = supervisor.unready(intent, record.input)
        args = (control.controller_name, safety, intent, is_finished, available, unready)
        found[intent] = transition(*args).refusal
    return found


def state(record: TickRecord, supervisor: Supervisor, *, is_simulated: bool) -> dict[str, Any]:
    """Return a tick, as far as the page shows it."""
    control, standby = record.output.control_mode, record.output.standby
    note = _ANEW if is_simulated else _AFRESH
    return {
        "time": record.input.state.time,
        "mode": control.mode.name,
        "controller": control.controller_name,
        "standby": None
        if standby is None
        else {
            "segment": standby.current_segment + 1,
            "segments": standby.total_segments,
            "progress": standby.progress,
            "finished": standby.is_finished,
        },
        "joints": {
            "position": record.input.state.joint_position.tolist(),
            "command": record.output.command.position.tolist(),
            "velocity": record.input.state.joint_velocity.tolist(),
            "effort": record.input.state.joint_effort.tolist(),
        },
        "safety": [_safety(status) for status in record.input.safety],
        "intents": {
            intent.value: _offered(intent.name, refusal, record)
            for intent, refusal in refusals(record, supervisor).items()
        }
        | {REACTIVATE: _offered(REACTIVATE.upper(), reactivation_refusal(control.mode), record) | {"note": note}},
    }


def _offered(name: str, refusal: str, record: TickRecord) -> dict[str, str]:
    """Return what a button shows; `why` leaves out what the page has elsewhere: its name, and safety statuses."""
    safety = describe_safety(merge_safety(record.input.safety))
    why = refusal.removeprefix(f"{name} refused: ").replace(safety, "see Safety below")
    return {"name": name, "refusal": refusal, "why": why}


def _safety(status: SafetyStatus) -> dict[str, Any]:
    meanings = [FLAG_MEANINGS.get(flag, f"flag {int(flag):#x}") for flag in status.flags]
    return {
        "level": status.level.name,
        "source": status.source,
        "flags": [f"{flag.name}: {meaning}" for flag, meaning in zip(status.flags, meanings, strict=True)],
        "message": status.message,
    }
