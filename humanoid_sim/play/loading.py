"""Loads another policy into a run: proved in a process of its own, built off the loop, then followed by all parts.

Whatever a checkpoint does while it is loaded, checked and run for the first time, it does to that process.
"""

from __future__ import annotations

import contextlib
import json
import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from humanoid_sim.assets import shipped
from humanoid_sim.client import LOAD_OPTIONS
from humanoid_sim.controllers.policy_step import Policy
from humanoid_sim.controllers.rl_policy import ticks_per_step
from humanoid_sim.errors import InputError, blaming
from humanoid_sim.evaluation.piano_score import PlayedKeys
from humanoid_sim.evaluation.tracking import AnchorErrors, TrackingErrors, errors_of_run
from humanoid_sim.frontends.launcher import ordinary_scheduling
from humanoid_sim.messages import SessionHeader
from humanoid_sim.mit import KEY_PRESSED, FloatArray, MITState
from humanoid_sim.play.conflicts import refuse_both, refuse_early, refuse_without_effect
from humanoid_sim.play.hardware_robot import check_policy
from humanoid_sim.play.options import PlayConfig
from humanoid_sim.play.played_robot import simulated_robot
from humanoid_sim.play.policies import PolicyChoice, choose_policy, policy_notices, require_joints
from humanoid_sim.policy.checkpoint import PLACEHOLDER, Checkpoint, file_digest, zero_policy
from humanoid_sim.policy.loaded_policy import load_policy
from humanoid_sim.policy.onnx_policy import OnnxModel, OnnxPolicy, has_onnxruntime
from humanoid_sim.rendering.ghost import ReferenceGhost
from humanoid_sim.robots.description import RobotDescription, load_robot, with_contract_physics
from humanoid_sim.session.loading import PreparedPolicy, considerate
from humanoid_sim.session.sources import parse_velocity
from humanoid_sim.stack import policy_controller, recorded_contract, recorded_motion, with_policy

if TYPE_CHECKING:
    from humanoid_sim.play.assembly import Run

_LONGEST = 120.0
"""s that the process may take."""
_NICENESS = 10
_PROGRAM = "from humanoid_sim.play.loading import main; main()"
_SHIPPED = {"policy": "policies", "motion": "motions", "song": "songs"}
"""Options that take the names of what ships, and of which kind that is."""


@dataclass(frozen=True, slots=True, eq=False)
class Proof:
    """A policy that the session can take."""

    header: SessionHeader
    config: PlayConfig
    source: str
    sha256: str
    """Digest of the file; empty where no network runs."""
    motion_file: str | None
    live: Mapping[str, int]
    taken: Mapping[str, int]
    """Live inputs that come from other programs."""
    command: FloatArray
    """Shape (3,), the velocity command to begin with, m/s, m/s and rad/s."""
    notices: tuple[str, ...]
    """Lines that an operator should know."""


def parse_options(text: str, config: PlayConfig) -> PlayConfig:
    """Read a request, a JSON object of texts that names files by absolute paths, into the session's options."""
    with blaming("its options are no JSON", ValueError):
        options = json.loads(text)
    if not isinstance(options, dict) or not options.get("policy"):
        raise InputError('expected a JSON object with "policy"')
    for name, value in options.items():
        if name not in LOAD_OPTIONS or not isinstance(value, str):
            raise InputError(f"'{name}': expected texts of {', '.join(LOAD_OPTIONS)}")
        kind = _SHIPPED.get(name)
        is_name = kind is not None and (value in shipped(kind) or (name, value) == ("policy", PLACEHOLDER))
        if name != "command" and not (is_name or os.path.isabs(value)):
            known = "" if kind is None else f", or one of {', '.join(shipped(kind))}"
            raise InputError(f"--{name}: is '{value}', expected an absolute path{known}")
    refuse_both("motion", "song", options.__contains__)
    fresh = {name: PlayConfig.__dataclass_fields__[name].default for name in LOAD_OPTIONS}
    return replace(config, motion_topic=None, **{**fresh, **options})


class Prover:
    """Starts the process, and ends it early if need be."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._lock = threading.Lock()
        self._is_cancelled = False

    def prove(self, config: PlayConfig, header: SessionHeader) -> Proof:
        """Check a policy, run it for the first time, and compute its golden vectors again.

        Raises `InputError` if the session cannot take it, and why.
        """
        with self._lock, ordinary_scheduling():
            if self._is_cancelled:
                raise InputError("the session ends")
            process = self._process = subprocess.Popen(
                [sys.executable, "-c", _PROGRAM],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                start_new_session=True,  # the terminal's Ctrl-C is for the run
            )
        try:
            answer, _ = process.communicate(pickle.dumps((config, header)), _LONGEST)
        except subprocess.TimeoutExpired:
            raise InputError(f"{config.policy}: could not be checked within {_LONGEST:g} s") from None
        finally:
            process.kill()
            process.communicate()
        try:
            result = pickle.loads(answer)
        except (EOFError, pickle.UnpicklingError):
            raise InputError(
                f"{config.policy}: the process that checked it ended with status {process.returncode}"
            ) from None
        if isinstance(result, Proof):
            return result
        raise InputError(str(result))

    def cancel(self) -> None:
        """End a process that runs, and start none any more."""
        with self._lock:
            self._is_cancelled = True
            if self._process is not None:
                with contextlib.suppress(ProcessLookupError):
                    self._process.kill()


def main() -> None:
    """Answer standard input, what `Prover.prove` is asked, with a `Proof`, or with the text of a refusal."""
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever a library prints is not an answer
    os.nice(_NICENESS)
    config, header = pickle.load(sys.stdin.buffer)
    result: Proof | str
    try:
        result = _proved(config, header)
    except InputError as error:
        result = str(error)
    except Exception as error:  # a bug, or a checkpoint that a library stumbles over: refused all the same
        result = f"{type(error).__name__}: {error}"
    with output:
        pickle.dump(result, output)


def _proved(config: PlayConfig, header: SessionHeader) -> Proof:
    period = header.control_period
    refuse_early(config)
    description = RobotDescription.from_json(header.documents["robot"], load_robot(config.robot).folder)
    policy = choose_policy(config, description)
    if policy.loaded is None or policy.checkpoint is None:
        raise InputError(f"--policy: is {config.policy}, expected one that runs")
    contract = policy.loaded.contract
    require_joints(contract, description)
    if not ticks_per_step(contract.policy_dt, period)[1]:
        raise InputError(
            f"{policy.source}: its policy_dt is {contract.policy_dt:g} s, expected a multiple of this session's "
            f"control period, {period:g} s; start play with it, or with another --control-frequency"
        )
    refuse_without_effect(config, contract, description)
    notices = [] if not policy.warning else [policy.warning]
    live: Mapping[str, int] = {}
    if config.hardware is None:
        setup = simulated_robot(config, description, period, contract)
        live = setup.live
        notices += setup.check_policy(contract)
        if with_contract_physics(description, contract) != description:
            notices.append("the simulated robot keeps the torque limits and joint damping that it was started with")
    else:
        has_imu = config.imu != "none" or config.hardware.startswith("virtual")
        notices += check_policy(contract, description, has_imu=has_imu)
    taken, live = policy.live_inputs(live)
    policy_controller(description, period, policy.loaded, live=live, action_limit=config.action_limit)
    settings, limit = {"options": asdict(config), **policy.settings}, config.action_limit
    return Proof(
        header=with_policy(header, policy.loaded, policy.motion, settings=settings, action_limit=limit),
        config=config,
        source=policy.checkpoint.source,
        sha256="" if policy.warning else policy.checkpoint.sha256,
        motion_file=policy.settings["motion"],
        live=live,
        taken=taken,
        command=parse_velocity(config.command, contract.command_ranges),
        notices=(*notices, *policy_notices(policy)),
    )


@dataclass(frozen=True, slots=True, eq=False)
class JudgedPolicy:
    """Parts of a run's figures and pictures that belong to the policy; all None without one."""

    tracking: TrackingErrors | None = None
    anchor: AnchorErrors | None = None
    keys: PlayedKeys | None = None
    ghost: ReferenceGhost | None = None

    @classmethod
    def of(cls, description: RobotDescription, policy: PolicyChoice, *, is_drawn: bool) -> JudgedPolicy:
        """Prepare to judge a policy; `is_drawn`: the run makes a page or a video."""
        loaded, motion = policy.loaded, policy.motion
        if loaded is None:
            return cls()
        tracking, anchor = errors_of_run(description, loaded, motion)
        keys = None
        if motion is not None and motion.task_type == "piano":
            keys = PlayedKeys(motion.frames, loaded.contract.policy_dt)
        ghost = ReferenceGhost.of(description, loaded.contract, loaded.reference) if is_drawn else None
        return cls(tracking, anchor, keys, ghost)

    def update(self, frame: int, state: MITState) -> None:
        """Compare the state of a policy step with the frame that the policy was shown."""
        if self.tracking is not None:
            self.tracking.update(frame, state.joint_position)
        if self.anchor is not None:
            self.anchor.update(frame, state)
        live = state.extern.get(KEY_PRESSED)
        if self.keys is not None and live is not None:
            self.keys.update(frame, live.value)


class PolicyLoader:
    """Prepares policies for `Loading`; of what it gives, only `follow` runs on the control thread."""

    def __init__(self, run: Run, header: SessionHeader) -> None:
        self._run, self.header = run, header
        """The run whose parts follow the policy, and its header."""
        self._prover = Prover()
        self.cancel = self._prover.cancel
        has_onnxruntime()  # imported now: later the import would stop the loop for 30 ms

    def prepare(self, options: str) -> PreparedPolicy:
        """Check, prove and build a policy. Raises `InputError` if the session cannot take it, and why."""
        run, plan = self._run, self._run.plan
        proof = self._prover.prove(parse_options(options, plan.config), self.header)
        with considerate():
            policy = _policy_of(proof, plan.config)
            assert policy.loaded is not None
            contract = policy.loaded.contract
            controller = policy_controller(
                plan.description,
                plan.control_period,
                policy.loaded,
                live=proof.live,
                action_limit=proof.config.action_limit,
            )
            judged = JudgedPolicy.of(plan.description, policy, is_drawn=run.moments is not None)
            measure = plan.setup.measure(contract)
            described = run.feed.prepare(proof.header, proof.taken)

        def follow() -> None:
            self.header = proof.header
            measure()
            plan.velocity.begin(proof.command, contract.command_ranges, is_observed=policy.walks)
            run.data.follow(plan.velocity if policy.walks else None, proof.taken, contract.live_timeouts)
            run.feed.follow(described)
            run.follow(policy, proof.config, judged)

        text = "; ".join((f"policy loaded: {policy}", *filter(None, proof.notices)))
        return PreparedPolicy(
            controller,
            proof.header,
            text,
            follow,
            announce=lambda: run.rename_policy(policy.source),
            discard=lambda: os.close(described),
        )


def _policy_of(proof: Proof, config: PlayConfig) -> PolicyChoice:
    """Return the policy that was proved, in this process: its network anew, everything else as it will be recorded."""
    contract, motion = recorded_contract(proof.header), recorded_motion(proof.header)
    assert contract is not None
    network: Policy = zero_policy(contract.action_count)
    if proof.sha256:
        path = Path(proof.source)
        model = OnnxModel(path)
        if config.hardware is not None:  # a fault, and so DAMPING, while the motors still listen
            model.time_limit = 0.5 * config.can_timeout
        network = policy = OnnxPolicy(model, contract.tensors)
        policy(np.zeros(policy.observation_width, dtype=np.float32), 0)
        if file_digest(path) != proof.sha256:
            raise InputError(f"{path}: has changed while it was checked")
    checkpoint = Checkpoint(contract, network, proof.source, proof.sha256)
    file = None if proof.motion_file is None else Path(proof.motion_file)
    return PolicyChoice(load_policy(contract, network, motion), checkpoint, motion, file)
