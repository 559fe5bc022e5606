"""A trace of the trainer's environment: what a contract makes of its states, and how the robot moved there."""

from __future__ import annotations

import math
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.policy_step import PolicyWiring, action_command
from humanoid_sim.controllers.terms import value_names
from humanoid_sim.doctor.edits import Edit, with_pose
from humanoid_sim.doctor.trial import Subject
from humanoid_sim.envs.config import Scenario
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.files import read_arrays
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.loaded_policy import contract_layout
from humanoid_sim.policy.traces import Trace, far_values, is_rounding, read_trace, replayed, value_name
from humanoid_sim.policy_tools.stamp import body_reader
from humanoid_sim.robots.description import with_joint_limits
from humanoid_sim.simulation.batch_sim import BatchSim
from humanoid_sim.simulation.floating_base import base_addresses
from humanoid_sim.simulation.model import joint_addresses

_CONSTANT = 1e-3  # rad, largest range over the samples of what is constant
_TIMESTEPS = (0.005, 0.001)  # s, of physics in predictions: no trace says which the trainer had
_TRANSITIONS = 40  # steps of the trace that are predicted
_RATE = (0.75, 1.5)  # seconds between rows as the joints move, over policy_dt: 1.0 to 1.2 where they are the same
_SPREAD = 0.3  # relative, of those seconds and of efforts, above which they say nothing
_GAIN = 1.75  # factor by which a gain that efforts show differs from the contract's


class Samples:
    """S policy steps of the trainer's environment."""

    def __init__(self, subject: Subject, path: Path) -> None:
        """Read them. Raises `InputError` if the file is malformed, or of another network."""
        self._subject, self._path = subject, path
        self._traces: dict[tuple[object, ...], Trace] = {}
        self._file = read_arrays(path)
        trace = self.trace(subject.contract)
        observed, width = trace.arrays["observation"], contract_layout(subject.contract).width
        if observed.shape[1] != width:
            raise InputError(f"{path}: observation has shape {observed.shape}, expected ({len(trace)}, {width})")
        frames = trace.arrays.get("frame", np.arange(len(trace))).tolist()
        answers = np.array([subject.checkpoint.policy(row, frame) for row, frame in zip(observed, frames, strict=True)])
        actions = trace.arrays["action"]
        if far_values("action", answers, actions).any():
            is_late = len(trace) > 1 and not far_values("action", answers[:-1], actions[1:]).any()
            why = "it answers that of the row before" if is_late else "another network's"
            raise InputError(f"{path}: action differs from what the policy answers to observation: {why}")

    def trace(self, contract: PolicyContract) -> Trace:
        """Return the trace with what a contract observes of the robot."""
        key = contract.anchor_body, contract.velocity_points
        if key not in self._traces:
            self._traces[key] = read_trace(self._path, contract, body_reader(self._subject.description, contract))
        return self._traces[key]

    def disagreement(self, contract: PolicyContract) -> str:
        """Return what a contract observes otherwise than the trainer did, in the first step with any; '' for nothing.

        Of each term the first such value is named, with its joint. Joint targets count where the trace has them.
        """
        trace = self.trace(contract)
        arrays, actions = trace.arrays, trace.arrays["action"]
        try:
            limited = with_joint_limits(contract, self._subject.description)
            loaded = self._subject.under(limited).checkpoint.with_motion()
            wiring = PolicyWiring(trace.joint_names, loaded.contract, loaded.reference, loaded.extern)
            for i, (_, observation) in enumerate(replayed(wiring, trace)):
                far = far_values("observation", observation, arrays["observation"][i])
                if far.any():
                    terms = {wiring.layout.term_at(k).name: k for k in reversed(np.flatnonzero(far).tolist())}
                    names = ", ".join(value_name(wiring, k) for k in reversed(terms.values()))
                    return f"{far.sum()} of {far.size} values in step {i}: {names}"
            position = action_command(wiring.action_map, actions).position
        except (FieldError, InputError) as error:  # the contract does not fit the trace
            return str(error)
        if not is_rounding(position, arrays.get("target", position), actions):
            return "joint targets"
        seconds = self._row_seconds(trace)
        is_far = not math.isnan(seconds) and not _RATE[0] < seconds / contract.policy_dt < _RATE[1]
        return f"the joints move as if its rows were {seconds:.2g} s apart" if is_far else ""

    def _row_seconds(self, trace: Trace) -> float:
        """Return the seconds from row to row, changes of the joints' positions over velocities; NaN if unknown."""
        position, velocity = trace.arrays["joint_position"], trace.arrays["joint_velocity"]
        mean = 0.5 * (velocity[1:] + velocity[:-1])
        squares = (mean**2).sum(axis=1)
        moving = squares > 0.01 * squares.max(initial=0.0)
        if not moving.any():
            return math.nan
        ratios = (np.diff(position, axis=0) * mean).sum(axis=1)[moving] / squares[moving]
        seconds = float(np.median(ratios))
        return seconds if np.median(np.abs(ratios - seconds)) < _SPREAD * seconds else math.nan

    def fitted_poses(self, contract: PolicyContract) -> list[Edit]:
        """Return the edit to the default pose that follows from the relative joint positions in the samples."""
        trace, found = self.trace(contract), []
        layout = contract_layout(contract)
        for item in layout.terms if layout.history == 1 else ():
            term, joints = item.term, value_names(item.term, contract)
            kind = contract.kind(term)
            if kind.reads == "joint_position" and kind.is_relative(term) and np.all(term.scale):
                columns = trace.arrays["observation"][:, item.start : item.stop].astype(np.float64)
                position = trace.arrays["joint_position"][:, [trace.joint_names.index(joint) for joint in joints]]
                poses = position - columns / term.scale
                if np.ptp(poses, axis=0).max() < _CONSTANT:
                    pose = contract.default_joint_pos.copy()
                    pose[[contract.joint_names.index(joint) for joint in joints]] = np.median(poses, axis=0).round(4)
                    edited = replace(contract, **with_pose(contract, pose))
                    found.append(Edit("the default pose is the one of the trace", "default pose", edited))
        return found

    def fitted_gains(self, contract: PolicyContract) -> list[Edit]:
        """Return the edit to the gains that follow from the array `effort`, N·m, of the joints, if there is one."""
        trace = self.trace(contract)
        effort = self._file.get("effort", np.empty(0)).astype(np.float64)
        if effort.shape != trace.arrays["joint_position"].shape or len(trace) < _TRANSITIONS:
            return []
        loaded = self._subject.under(with_joint_limits(contract, self._subject.description)).checkpoint.with_motion()
        wiring = PolicyWiring(trace.joint_names, loaded.contract, loaded.reference, loaded.extern)
        target = action_command(wiring.action_map, trace.arrays["action"]).position
        position, velocity = trace.arrays["joint_position"], trace.arrays["joint_velocity"]
        fits: list[tuple[float, FloatArray]] = []
        for aim in (target[1:], target[:-1]):  # effort of the row's own action, or what the last one led to
            unknowns = np.stack([aim - position[1:], -velocity[1:]], axis=-1)  # · (K_p, K_d) = effort
            pairs = zip(unknowns.swapaxes(0, 1), effort[1:].T, strict=True)
            gains = np.array([np.linalg.lstsq(columns, values)[0] for columns, values in pairs])
            fits.append((float(np.linalg.norm((unknowns * gains).sum(axis=-1) - effort[1:])), gains))
        missed, gains = min(fits, key=lambda fit: fit[0])
        places = [trace.joint_names.index(joint) for joint in contract.joint_names]
        changed = dict[str, Any]()
        for name, fitted in zip(("joint_stiffness", "joint_damping"), gains[places].T, strict=True):
            own = getattr(contract, name)
            differs = (fitted > 0.0) & (own > 0.0) & ((fitted > _GAIN * own) | (own > _GAIN * fitted))
            if differs.any():
                changed[name] = np.where(differs, [float(f"{value:.3g}") for value in fitted], own)
        if not changed or missed > _SPREAD * np.linalg.norm(effort):
            return []
        return [Edit("the gains are those of the trace's efforts", "gains", replace(contract, **changed))]

    def prediction_error(self, contract: PolicyContract) -> float:
        """Return by what share simulated single steps miss the trace's changes of joint speed; inf if unknown."""
        if "qpos" not in self._file or len(self.trace(contract)) < 2:  # a change takes two rows
            return math.inf
        try:
            scenarios = [self._subject.under(contract).scenario(timestep) for timestep in _TIMESTEPS]
        except (FieldError, InputError):
            return math.inf
        return min(self._missed(contract, scenario) for scenario in scenarios)

    def _missed(self, contract: PolicyContract, scenario: Scenario) -> float:
        trace = self.trace(contract)
        steps = np.unique(np.linspace(0, len(trace) - 2, _TRANSITIONS).astype(np.intp))
        with closing(
            BatchSim(scenario.description, len(steps), scenario.sim_config, implicit=True, threads=1)
        ) as robots:
            joints = joint_addresses(robots.model(0), robots.joints)
            column = [trace.joint_names.index(name) for name in robots.joints]
            speed = trace.arrays["joint_velocity"][:, column]
            qpos, qvel = robots.start_pose.qpos((len(steps),)), np.zeros_like(robots.qvel)
            qpos[:, joints.qpos], qvel[:, joints.dof] = trace.arrays["joint_position"][steps][:, column], speed[steps]
            if scenario.description.is_floating:
                place, turn, linear, angular = base_addresses(robots.model(0), scenario.description)
                qpos[:, place], qpos[:, turn] = self._file["qpos"][steps, :3], self._file["qpos"][steps, 3:7]
                qvel[:, linear], qvel[:, angular] = self._file["qvel"][steps, :3], self._file["qvel"][steps, 3:6]
            robots.reset(qpos=qpos, qvel=qvel)
            robots.step(action_command(scenario.wiring.action_map, trace.arrays["action"][steps]))
            off = ((robots.qvel[:, joints.dof] - speed[steps + 1]) ** 2).sum()
            change = ((speed[steps + 1] - speed[steps]) ** 2).sum()
            return math.inf if robots.fault.any() or not change else math.sqrt(off / change)
