"""A trace of the trainer's environment: what a contract makes of its states, and how the robot moved there."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.policy_step import PolicyMemory, PolicyWiring, action_command, advance_phase
from humanoid_sim.controllers.reference import Alignment
from humanoid_sim.controllers.terms import value_names
from humanoid_sim.doctor.edits import Edit, with_pose, with_term
from humanoid_sim.doctor.trial import TIMESTEP, Simulations, Subject
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.files import read_arrays
from humanoid_sim.mit import COMMAND_FIELDS, VELOCITY_COMMAND, BoolArray, Extern, Float32Array, MITCommand, MITState
from humanoid_sim.policy.findings import shown
from humanoid_sim.policy.loaded_policy import contract_layout
from humanoid_sim.policy.traces import EXTERN, STATE_ARRAYS, Trace, read_trace, value_name
from humanoid_sim.policy_tools.stamp import body_reader
from humanoid_sim.robots.description import with_joint_limits
from humanoid_sim.simulation.floating_base import base_addresses
from humanoid_sim.simulation.model import joint_addresses

_TOLERANCE = 1e-4  # of an observation: absolute up to 1, relative beyond; float32 sums in another order stay below
_ACTION_TOLERANCE = 1e-3  # networks amplify the rounding of other hardware
_ROUNDING = 0.5e-3  # largest error of an action scale or offset with three decimals
_CONSTANT = 1e-3  # largest range over the samples of what is constant
_TRANSITIONS = 40  # steps of the trace that are predicted
_TIMESTEPS = (TIMESTEP, 0.001)  # s, of physics in predictions: no trace says which the trainer had


class Samples:
    """S policy steps of the trainer's environment."""

    def __init__(self, subject: Subject, path: Path) -> None:
        """Read them. Raises `InputError` if the file is malformed, or of another network."""
        self._subject, self._path, self._simulations = subject, path, Simulations(subject)
        self._traces: dict[tuple[object, ...], Trace] = {}
        self._file = read_arrays(path)
        trace = self.trace(subject.contract)
        observed, width = trace.arrays["observation"], contract_layout(subject.contract).width
        if observed.shape[1] != width:
            raise InputError(f"{path}: observation has shape {observed.shape}, expected ({len(trace)}, {width})")
        steps = zip(observed, _frames(trace, 10**9).tolist(), strict=True)
        own = np.array([subject.policy(row, frame) for row, frame in steps])
        if _far(own, trace.arrays["action"], _ACTION_TOLERANCE).any():
            raise InputError(f"{path}: action differs from what the policy answers to observation: another network's")

    def trace(self, contract: PolicyContract) -> Trace:
        """Return the trace with what a contract observes of the robot."""
        key = contract.anchor_body, contract.velocity_points
        if key not in self._traces:
            self._traces[key] = read_trace(self._path, contract, body_reader(self._subject.description, contract))
        return self._traces[key]

    def wiring(self, contract: PolicyContract) -> PolicyWiring:
        """Return a contract's wiring on the joints of the trace."""
        loaded = self._subject.load(with_joint_limits(contract, self._subject.description))
        joints = self.trace(contract).joint_names
        return PolicyWiring(joints, loaded.contract, loaded.reference, loaded.extern)

    def observed(self, contract: PolicyContract) -> Float32Array:
        """Return what the policy would have observed in the S states, shape (S, N)."""
        wiring, trace = self.wiring(contract), self.trace(contract)
        arrays, steps, actions = trace.arrays, len(trace), trace.arrays["action"]
        zeros = np.zeros((steps, len(trace.joint_names)))
        live = {name: Extern(array, 0.0) for name, array in trace.under(EXTERN).items()}
        rows = {name: arrays[name] for name in STATE_ARRAYS}
        state = MITState(time=0.0, **rows, joint_effort=zeros, joint_age=zeros, extern=live)
        alignment = wiring.activate(trace.state(0)).alignment
        if "alignment" in arrays:
            alignment = Alignment(yaw=arrays["alignment"][:, 3:], offset=arrays["alignment"][:, :3])
        memory = PolicyMemory(
            frame=_frames(trace, wiring.reference.frame_count),
            last_action=arrays.get("last_action", np.vstack([np.zeros_like(actions[:1]), actions[:-1]])),
            walked=arrays.get("walked", _walked(contract, arrays.get(EXTERN + VELOCITY_COMMAND), steps)),
            alignment=alignment,
        )
        observation, after = wiring.observe(memory, state)
        if after.history is None:
            return observation
        newest, length = after.history[:, -1], after.history.shape[1]
        past = np.maximum(np.arange(steps)[:, None] + np.arange(-length, 0), 0)  # the first step stands for all before
        return wiring.observe(replace(memory, history=arrays.get("history", newest[past])), state)[0]

    def differing(self, contract: PolicyContract) -> BoolArray:
        """Return which of the N observed values, and of the joint targets, differ in any sample."""
        arrays = self.trace(contract).arrays
        try:
            far = _far(self.observed(contract), arrays["observation"], _TOLERANCE).any(axis=0)
            position = action_command(self.wiring(contract).action_map, arrays["action"]).position
        except (FieldError, InputError, ValueError):  # the contract does not fit the trace
            return np.ones(arrays["observation"].shape[1], dtype=np.bool_)
        target = arrays.get("target", position)
        off = np.abs(position - target).max(axis=0) > _ROUNDING * (1.0 + np.abs(arrays["action"]).max())
        return np.concatenate([far, off])

    def names(self, contract: PolicyContract, differing: BoolArray) -> str:
        """Name the values that `differing` marks: of each term the first, with its joint."""
        wiring, found = self.wiring(contract), dict[str, str]()
        for i in np.flatnonzero(differing[: wiring.layout.width]).tolist():
            found.setdefault(wiring.layout.term_at(i).name, value_name(wiring, i))
        return ", ".join(found.values()) or "joint targets"

    def fitted(self, contract: PolicyContract) -> tuple[Edit, ...]:
        """Return edits whose values follow from the samples: the default pose, and the scale of each term."""
        layout, trace, found = self.wiring(contract).layout, self.trace(contract), []
        for item in layout.terms if layout.history == 1 else ():
            columns, term = trace.arrays["observation"][:, item.start : item.stop].astype(np.float64), item.term
            kind, joints = contract.kind(term), value_names(term, contract)
            if kind.reads == "joint_position" and kind.is_relative(term) and np.all(term.scale):
                position = trace.arrays["joint_position"][:, [trace.joint_names.index(joint) for joint in joints]]
                poses = position - columns / term.scale
                if np.ptp(poses, axis=0).max() < _CONSTANT:
                    pose = contract.default_joint_pos.copy()
                    pose[[contract.joint_names.index(joint) for joint in joints]] = np.median(poses, axis=0).round(4)
                    edited = replace(contract, **with_pose(contract, pose))
                    found.append(Edit("the default pose is the one of the trace", "default pose", edited))
            plain = replace(contract, **with_term(contract, term, scale=1.0, clip=None))
            raw = self.observed(plain)[:, item.start : item.stop].astype(np.float64)
            scale = (raw * columns).sum(axis=0) / np.maximum((raw * raw).sum(axis=0), 1e-12)
            if np.abs(raw * scale - columns).max() < _CONSTANT and raw.any(axis=0).all():
                value: Any = scale.mean().round(4) if np.ptp(scale) < _CONSTANT else scale.round(4)
                edited = replace(contract, **with_term(contract, term, scale=value))
                found.append(Edit(f"{item.name} is multiplied by {shown(value)}", f"{item.name} scale", edited))
        return tuple(found)

    def period(self) -> float:
        """Return the time from sample to sample, s, by the joints' positions and velocities; 0 if nothing moves."""
        arrays = self.trace(self._subject.contract).arrays
        moved, speed = np.diff(arrays["joint_position"], axis=0), arrays["joint_velocity"]
        mean = 0.5 * (speed[1:] + speed[:-1])
        fast = np.abs(mean) > 0.2 * np.abs(mean).max()
        return float(np.median(moved[fast] / mean[fast])) if mean.any() else 0.0

    def prediction_error(self, contract: PolicyContract) -> float:
        """Return by what share simulated single steps miss the trace's changes of joint speed; inf if unknown."""
        if "qpos" not in self._file:
            return math.inf
        try:
            return min(self._prediction_error(contract, timestep) for timestep in _TIMESTEPS)
        except (FieldError, InputError):
            return math.inf

    def _prediction_error(self, contract: PolicyContract, timestep: float) -> float:
        trace = self.trace(contract)
        steps = np.unique(np.linspace(0, len(trace) - 2, _TRANSITIONS).astype(np.intp))
        robots = self._simulations.robots(contract, len(steps), timestep=timestep)
        joints = joint_addresses(robots.model(0), robots.joints)
        column = [trace.joint_names.index(name) for name in robots.joints]
        speed = trace.arrays["joint_velocity"][:, column]
        qpos, qvel = robots.start_pose.qpos((len(steps),)), np.zeros_like(robots.qvel)
        qpos[:, joints.qpos], qvel[:, joints.dof] = trace.arrays["joint_position"][steps][:, column], speed[steps]
        if self._subject.description.is_floating:
            place, turn, linear, angular = base_addresses(robots.model(0), self._subject.description)
            qpos[:, place], qpos[:, turn] = self._file["qpos"][steps, :3], self._file["qpos"][steps, 3:7]
            qvel[:, linear], qvel[:, angular] = self._file["qvel"][steps, :3], self._file["qvel"][steps, 3:6]
        robots.reset(qpos=qpos, qvel=qvel)
        command = action_command(self.wiring(contract).action_map, trace.arrays["action"][steps])
        robots.step(MITCommand(*(getattr(command, name)[:, column] for name in COMMAND_FIELDS)))
        off = ((robots.qvel[:, joints.dof] - speed[steps + 1]) ** 2).sum()
        change = ((speed[steps + 1] - speed[steps]) ** 2).sum()
        return math.inf if robots.fault.any() or not change else math.sqrt(off / change)


def _frames(trace: Trace, count: int) -> npt.NDArray[np.int64]:
    return np.minimum(trace.arrays.get("frame", np.arange(len(trace))), count - 1)


def _walked(contract: PolicyContract, command: npt.NDArray[Any] | None, steps: int) -> npt.NDArray[np.float64]:
    """Return the gait phase before each step, rad, shape (S,)."""
    walked = np.zeros(steps)
    commands = np.zeros((steps, 3)) if command is None else command
    for i in range(steps - 1):
        if contract.phase is not None:
            walked[i + 1] = advance_phase(contract.phase, walked[i], commands[i], contract.policy_dt)[0]
    return walked


def _far(value: npt.NDArray[np.floating], expected: npt.NDArray[np.floating], tolerance: float) -> BoolArray:
    with np.errstate(invalid="ignore"):  # infinity - infinity
        return np.asarray(~(np.abs(value - expected) <= tolerance * np.maximum(1.0, np.abs(expected))))
