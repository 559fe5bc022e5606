"""What a run will be: everything is chosen and checked here, and nothing is written, sent or taken over yet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from humanoid_sim.controllers.supervisor import Supervisor
from humanoid_sim.mit import EXTERN_WIDTHS, VELOCITY_COMMAND
from humanoid_sim.play.config import PlayConfig
from humanoid_sim.play.operators import keys_of
from humanoid_sim.play.options import Outputs, choose_outputs, control_rate, no_outputs, refuse_conflicts
from humanoid_sim.play.policies import PolicyChoice, choose_policy
from humanoid_sim.play.robot_parts import RobotParts
from humanoid_sim.play.schedule import automatic_script
from humanoid_sim.play.simulated import simulated_robot
from humanoid_sim.policy.readers.sources import assumptions
from humanoid_sim.rendering.backend import has_display
from humanoid_sim.robots.description import RobotDescription, load_robot, with_contract
from humanoid_sim.session.inject import Injector, parse_injections
from humanoid_sim.session.script import ScriptStep, parse_script
from humanoid_sim.session.session import Session
from humanoid_sim.session.sources import VelocityCommand, parse_velocity
from humanoid_sim.stack import build_supervisor

__all__ = ["Plan", "RobotClock", "make_plan"]


class RobotClock:
    """The robot's clock, once there is a session to ask; parts that the session is made of need it before."""

    session: Session | None = None

    def __call__(self) -> float:
        """The time of the latest reading, s; 0 before there is one."""
        return self.session.time if self.session is not None else 0.0


@dataclass(frozen=True, slots=True)
class Plan:
    """A run that can be made."""

    config: PlayConfig
    description: RobotDescription
    policy: PolicyChoice
    control_period: float
    """s"""
    realtime: bool
    parts: RobotParts
    supervisor: Supervisor
    steps: Sequence[ScriptStep] | None
    """What drives the FSM if no operator does; None: only operators do."""
    velocity: VelocityCommand
    injector: Injector
    clock: RobotClock
    outputs: Outputs
    notices: tuple[str, ...]
    """What an operator should know, one line each."""

    @property
    def motion_frames(self) -> int:
        """Length of the policy's motion in policy steps; 0 for none."""
        return 0 if self.policy.motion is None else len(self.policy.motion.frames)

    @property
    def shows_window(self) -> bool:
        """Whether a window opens."""
        return shows_window(self.config)


def make_plan(config: PlayConfig) -> Plan:
    """Choose and check.

    Emulated motors, if the options ask for them, run from here on: whoever makes a plan calls `parts.release` in the
    end.

    Raises:
        InputError: the first thing that is wrong.
    """
    injections = parse_injections(config.inject)
    steps: Sequence[ScriptStep] | None = None if config.script is None else parse_script(config.script)
    refuse_conflicts(config, steps or (), injections)
    description = load_robot(config.robot)
    clock = RobotClock()
    injector = Injector(injections, clock)
    policy = choose_policy(config, description, injector.policy)
    contract = policy.loaded.contract
    if Path(config.robot).suffix.lower() == ".xml":
        description = with_contract(description, contract)
    control_period, notice = control_rate(config, description, contract.policy_dt)
    parts = _robot(config, description, control_period, contract.anchor_body)
    try:
        supervisor = build_supervisor(
            description,
            control_period,
            policy.loaded,
            remote=config.remote != "none",
            live={**parts.live, VELOCITY_COMMAND: EXTERN_WIDTHS[VELOCITY_COMMAND]},
            action_limit=config.action_limit,
        )
        warnings = parts.check_policy(contract)
        frames = 0 if policy.motion is None else len(policy.motion.frames)
        if steps is None and not config.manual and config.hardware is None:
            steps = parse_script(automatic_script(config, frames))
        velocity = VelocityCommand(parse_velocity(config.command, contract.command_ranges), contract.command_ranges)
        golden = f"golden vectors: {policy.checkpoint.golden}" if policy.checkpoint.golden else ""
        drivers = keys_of(config.manual, walks=policy.walks) or _from_elsewhere(steps, config.dry_run)
        texts = (notice, *parts.notices, *warnings, *assumptions(contract), golden, *drivers)
        return Plan(
            config=config,
            description=description,
            policy=policy,
            control_period=control_period,
            realtime=_realtime(config),
            parts=parts,
            supervisor=supervisor,
            steps=steps,
            velocity=velocity,
            injector=injector,
            clock=clock,
            outputs=no_outputs() if config.dry_run else choose_outputs(config),
            notices=tuple(text for text in texts if text),
        )
    except BaseException:
        parts.release()
        raise


def _robot(config: PlayConfig, description: RobotDescription, control_period: float, anchor_body: str) -> RobotParts:
    if config.hardware is None:
        return simulated_robot(config, description, control_period, anchor_body)
    from humanoid_sim.play.real import real_robot  # noqa: PLC0415 - python-can and pyserial only where they are used

    return real_robot(config, description, control_period)


def _from_elsewhere(steps: Sequence[ScriptStep] | None, dry_run: bool) -> tuple[str, ...]:
    if steps is not None or dry_run:
        return ()
    return ("waits for an operator in another terminal: python -m humanoid_sim.mode damp, load_a, start_locomotion",)


def shows_window(config: PlayConfig) -> bool:
    """Whether a run with these options opens a window."""
    return config.viewer == "native" or (config.viewer == "auto" and has_display())


def _realtime(config: PlayConfig) -> bool:
    """Whether somebody, or a thread or a bus that lives in real time, takes part."""
    if config.hardware is not None:
        return True
    if config.pace != "auto":
        return config.pace == "realtime"
    return config.manual or config.remote != "none" or shows_window(config)
