"""Plan of a run: everything is chosen and checked here, and nothing is written, sent or taken over yet."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

from humanoid_sim.controllers.rl_policy import ticks_per_step
from humanoid_sim.errors import InputError
from humanoid_sim.play.front_ends import (
    automatic_steps,
    is_realtime,
    look_for_gamepad,
    operator_notices,
    wanted_front_ends,
)
from humanoid_sim.play.options import PlayConfig
from humanoid_sim.play.outputs import Outputs, choose_outputs
from humanoid_sim.play.played_robot import RobotSetup, simulated_robot
from humanoid_sim.play.policies import choose_for_robot, policy_notices
from humanoid_sim.play.refusals import options_without_effect, refuse
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.robots.guards import describe_unwatched
from humanoid_sim.robots.rates import MOST_STEPS, steps_per_period
from humanoid_sim.session.script import parse_script
from humanoid_sim.session.sources import VelocityCommand, parse_velocity
from humanoid_sim.stack import build_supervisor

if TYPE_CHECKING:
    from humanoid_sim.session.session import Session


class Plan:
    """A run that can be made."""

    session: Session | None = None
    """The session that is made of it; None before there is one."""

    def __init__(self, config: PlayConfig, left: ExitStack) -> None:
        """Choose and check. `left` lets go of emulated motors, which run from here on if the options ask for them."""
        steps = None if config.script is None else parse_script(config.script)
        refuse(config)
        front_ends = wanted_front_ends(config)
        description = load_robot(config.robot, config.imu_site)
        self.config = config
        self.realtime = is_realtime(config, front_ends)
        self.policy, self.description = choose_for_robot(config, description)
        description = self.description
        contract = self.policy.contract
        policy_dt = None if contract is None else contract.policy_dt
        self.control_period, moved = control_rate(config, description, policy_dt)
        self.setup = setup = self._robot(left)
        self.taken, live = self.policy.live_inputs(setup.live)
        """Name and width of the live inputs that come from other programs."""
        self.supervisor = build_supervisor(
            description,
            self.control_period,
            self.policy.loaded,
            policies=self.policy.named,
            remote=True,
            live=live,
            action_limit=config.action_limit,
        )
        warnings = [line for one in self.policy.contracts for line in setup.check_policy(one)]
        pads = look_for_gamepad(config)
        if steps is None and not config.manual and config.hardware is None:
            steps = automatic_steps(config, self.policy.motion)
        self.steps = steps
        """Steps that drive the FSM if no operator does; None: only operators do."""
        self.velocity = self._velocity()
        notices = (
            moved,
            *options_without_effect(config, contract, description),
            *setup.notices,
            describe_unwatched(description),
            *warnings,
            *(line for one in self.policy.choices for line in policy_notices(one)),
            *pads,
            *operator_notices(config, steps, contract, self.taken),
        )
        self.notices = [text for text in notices if text]
        """Notices for an operator, one line each."""
        self.outputs = Outputs() if config.dry_run else choose_outputs(config, self.policy.motion_file)
        self.front_ends = () if config.dry_run else front_ends

    def clock(self) -> float:
        """Return the robot's time as of the latest reading, s; 0 before there is one."""
        return self.session.time if self.session is not None else 0.0

    def _robot(self, left: ExitStack) -> RobotSetup:
        if self.config.hardware is None:
            return simulated_robot(self.config, self.description, self.control_period, self.policy.contracts)
        # python-can and pyserial only where they are used
        from humanoid_sim.play.hardware_robot import real_robot  # noqa: PLC0415

        return real_robot(self.config, self.description, self.control_period, left, self.policy.contracts)

    def _velocity(self) -> VelocityCommand:
        walking = (contract for contract in self.policy.contracts if contract.takes_velocity_command)
        ranges = next((contract.command_ranges for contract in walking), None)
        return VelocityCommand(parse_velocity(self.config.command, ranges), ranges, is_observed=self.policy.walks)


def control_rate(config: PlayConfig, description: RobotDescription, policy_dt: float | None) -> tuple[float, str]:
    """Return the control period in s, and what to tell the user if it is not the robot's own, or ''.

    Where the policy's period is not a multiple of the control period, the control rate moves to the nearest that is. On
    hardware there is no physics step to divide it. Raises `InputError` if the physics step does not divide the control
    period, or the policy's period has too many ticks.
    """
    settings = description.simulation if config.hardware is None else description.hardware
    frequency = config.control_frequency or settings.control_frequency
    period, notice = 1.0 / frequency, ""
    if policy_dt is not None:
        if policy_dt * frequency > MOST_STEPS:
            raise InputError(
                f"--control-frequency: is {frequency:g} Hz, expected at most {MOST_STEPS / policy_dt:g} Hz, "
                f"which makes {MOST_STEPS} ticks of the policy's {policy_dt:g} s"
            )
        ticks, is_whole = ticks_per_step(policy_dt, period)
        if not is_whole:
            period = policy_dt / ticks
            notice = (
                f"the control rate moves from {frequency:g} Hz to {1.0 / period:g} Hz, "
                f"{ticks} times the policy's {1.0 / policy_dt:g} Hz"
            )
    if config.hardware is not None:
        return period, notice
    timestep = config.physics_timestep or description.simulation.physics_timestep
    try:
        steps_per_period(period, timestep, step_name="--physics-timestep")
    except InputError as error:
        raise InputError(f"{error}; {notice}" if notice else str(error)) from None
    return period, notice
