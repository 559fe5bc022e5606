"""Proof that a running session can take another policy, found in a process of its own.

Whatever a checkpoint does while it is loaded, checked and run for the first time, it does to that process.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace

from humanoid_sim.assets import shipped
from humanoid_sim.client import LOAD_OPTIONS
from humanoid_sim.controllers.policy_step import resolve_action
from humanoid_sim.controllers.rl_policy import ticks_per_step
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.frontends.launcher import ordinary_scheduling
from humanoid_sim.messages import SessionHeader
from humanoid_sim.mit import EXTERN_WIDTHS, VELOCITY_COMMAND, FloatArray
from humanoid_sim.play.conflicts import refuse_without_effect
from humanoid_sim.play.early import refuse_early
from humanoid_sim.play.hardware_robot import check_policy
from humanoid_sim.play.options import PlayConfig
from humanoid_sim.play.plan import policy_notices
from humanoid_sim.play.played_robot import simulated_robot
from humanoid_sim.play.policies import PolicyChoice, choose_policy
from humanoid_sim.policy.checkpoint import PLACEHOLDER
from humanoid_sim.policy.random_songs import is_generated
from humanoid_sim.robots.description import RobotDescription, load_robot, with_contract_physics
from humanoid_sim.session.sources import parse_velocity
from humanoid_sim.stack import policy_controller, with_policy
from humanoid_sim.strict_json import parse_json

__all__ = ["Proof", "Prover", "parse_options"]

_LONGEST = 120.0
"""s that the process may take."""
_NICENESS = 10
_PROGRAM = "from humanoid_sim.play.proof import main; main()"
_SHIPPED = {"policy": "policies", "motion": "motions", "song": "songs"}
"""Options that take the names of what ships, and of which kind that is."""


@dataclass(frozen=True, slots=True)
class _Job:
    config: PlayConfig
    """Options of the session, with the policy's."""
    header: SessionHeader
    """Header of the run so far."""


@dataclass(frozen=True, slots=True, eq=False)
class Proof:
    """A policy that the session can take."""

    header: SessionHeader
    """Header of the run with it."""
    config: PlayConfig
    source: str
    sha256: str
    """Digest of the file; empty where no network runs."""
    motion_file: str | None
    live: Mapping[str, int]
    """Name and width of all live inputs."""
    taken: Mapping[str, int]
    """Live inputs that come from other programs."""
    command: FloatArray
    """Shape (3,), the velocity command to begin with, m/s, m/s and rad/s."""
    notices: tuple[str, ...]
    """Lines that an operator should know."""


def parse_options(text: str, config: PlayConfig) -> PlayConfig:
    """Read a request, which names files by absolute paths, into the session's options.

    Args:
        text: of the request, a JSON object of texts.
        config: of the session.

    Raises:
        InputError: naming the option.
    """
    try:
        options = parse_json(text)
    except ValueError as error:
        raise InputError(f"its options are no JSON: {error}") from None
    if not isinstance(options, dict) or not options.get("policy"):
        raise InputError('expected a JSON object with "policy"')
    for name, value in options.items():
        if name not in LOAD_OPTIONS or not isinstance(value, str):
            raise InputError(f"'{name}': expected texts of {', '.join(LOAD_OPTIONS)}")
        kind = _SHIPPED.get(name)
        is_name = kind is not None and (value in shipped(kind) or (name, value) == ("policy", PLACEHOLDER))
        if name != "command" and not (is_name or os.path.isabs(value) or (name == "song" and is_generated(value))):
            known = "" if kind is None else f", or one of {', '.join(shipped(kind))}"
            raise InputError(f"--{name}: is '{value}', expected an absolute path{known}")
    if "motion" in options and "song" in options:
        raise InputError("--motion and --song: both are given, expected one of them")
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

        Args:
            config: of the session, with the policy's options.
            header: of the run so far.

        Raises:
            InputError: the session cannot take it, and why.
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
            answer, _ = process.communicate(pickle.dumps(_Job(config, header)), _LONGEST)
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
    """Answer standard input, a `_Job`, with a `Proof`, or with the text of a refusal."""
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever a library prints is no answer
    os.nice(_NICENESS)
    job: _Job = pickle.load(sys.stdin.buffer)
    result: Proof | str
    try:
        result = _proved(job)
    except InputError as error:
        result = str(error)
    except Exception as error:  # a bug, or a checkpoint that a library stumbles over: refused all the same
        result = f"{type(error).__name__}: {error}"
    with output:
        pickle.dump(result, output)


def _proved(job: _Job) -> Proof:
    config, header = job.config, job.header
    period = header.control_period
    refuse_early(config)
    description = RobotDescription.from_json(header.documents["robot"], load_robot(config.robot).folder)
    policy = choose_policy(config, description)
    if policy.loaded is None or policy.checkpoint is None:
        raise InputError(f"--policy: is {config.policy}, expected one that runs")
    contract = policy.loaded.contract
    try:
        resolve_action(contract, description.joint_names)
    except FieldError as error:
        raise InputError(f"policy on robot '{description.name}': {error}") from None
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
    taken = policy.loaded.taken(live)
    live = {**taken, **live, VELOCITY_COMMAND: EXTERN_WIDTHS[VELOCITY_COMMAND]}
    policy_controller(description, period, policy.loaded, live=live, action_limit=config.action_limit)
    return Proof(
        header=_with(header, config, policy),
        config=config,
        source=policy.checkpoint.source,
        sha256="" if policy.warning else policy.checkpoint.sha256,
        motion_file=policy.settings["motion"],
        live=live,
        taken=taken,
        command=parse_velocity(config.command, contract.command_ranges),
        notices=(*notices, *policy_notices(policy)),
    )


def _with(header: SessionHeader, config: PlayConfig, policy: PolicyChoice) -> SessionHeader:
    assert policy.loaded is not None
    settings = {"options": asdict(config), **policy.settings}
    return with_policy(header, policy.loaded, policy.motion, settings=settings, action_limit=config.action_limit)
