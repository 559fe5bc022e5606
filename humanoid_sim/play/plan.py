"""Plan of a run: everything is chosen and checked here, and nothing is written, sent or taken over yet."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from humanoid_sim.assets import sample_policy, shipped
from humanoid_sim.controllers.contract import PolicyContract, live_topic
from humanoid_sim.controllers.policy_step import resolve_action
from humanoid_sim.controllers.rl_policy import RLPolicyController, ticks_per_step
from humanoid_sim.controllers.supervisor import Supervisor
from humanoid_sim.errors import FieldError, InputError, known_names
from humanoid_sim.files import is_file
from humanoid_sim.frontends import Wanted
from humanoid_sim.messages import Intent
from humanoid_sim.mit import EXTERN_WIDTHS, KEY_PRESSED, VELOCITY_COMMAND
from humanoid_sim.play.branch import Branch, open_branch, reach
from humanoid_sim.play.conflicts import (
    Outputs,
    choose_outputs,
    refuse_conflicts,
    refuse_unheard_keys,
    refuse_without_effect,
)
from humanoid_sim.play.early import checkpoint_path
from humanoid_sim.play.front_ends import has_keys, look_for_gamepad, operated_by, wanted_front_ends, with_keyboard
from humanoid_sim.play.options import DEFAULT_ROBOT, PlayConfig
from humanoid_sim.play.played_robot import RobotSetup, simulated_robot
from humanoid_sim.play.policies import PolicyChoice, choose_policy, parse_branch
from humanoid_sim.policy.checkpoint import read_contract
from humanoid_sim.policy.motion import Motion
from humanoid_sim.policy.readers.complete import UnnamedJointsError
from humanoid_sim.policy.readers.sources import assumptions
from humanoid_sim.robots.description import (
    RobotDescription,
    load_robot,
    with_check_poses,
    with_contract,
    with_contract_physics,
    with_imu,
)
from humanoid_sim.robots.guards import describe_unwatched
from humanoid_sim.robots.rates import MOST_STEPS, steps_per_period
from humanoid_sim.session.inject import Injector, parse_injections
from humanoid_sim.session.keyboard import key_help
from humanoid_sim.session.script import ScriptStep, parse_script
from humanoid_sim.session.session import Session
from humanoid_sim.session.sources import VelocityCommand, parse_velocity, velocity_key_help
from humanoid_sim.simulation.check_poses import check_pose_problems
from humanoid_sim.simulation.plant import timestep_of
from humanoid_sim.stack import build_supervisor, policy_controller


class RobotClock:
    """The robot's clock, once there is a session to ask; parts that the session is made of need it before."""

    session: Session | None = None

    def __call__(self) -> float:
        """Return the time of the latest reading, s; 0 before there is one."""
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
    setup: RobotSetup
    supervisor: Supervisor
    shadow: RLPolicyController | None
    """Controller of a policy that only looks on; the supervisor has none then."""
    steps: Sequence[ScriptStep] | None
    """Steps that drive the FSM if no operator does; None: only operators do."""
    taken: Mapping[str, int]
    """Name and width of the live inputs that come from other programs."""
    velocity: VelocityCommand
    branch: Branch | None
    """The recorded instant in which it begins; None for a beginning of its own."""
    injector: Injector
    clock: RobotClock
    outputs: Outputs
    front_ends: tuple[Wanted, ...]
    """Front ends that are started with it."""
    notices: tuple[str, ...]
    """Notices for an operator, one line each."""


def make_plan(config: PlayConfig) -> Plan:
    """Choose and check.

    Emulated motors, if the options ask for them, run from here on: whoever makes a plan calls `setup.release` in the
    end.
    """
    injections = parse_injections(config.inject)
    steps: Sequence[ScriptStep] | None = None if config.script is None else parse_script(config.script)
    refuse_conflicts(config, injections)
    front_ends = wanted_front_ends(config)
    point = None if config.branch is None else open_branch(config)
    description = with_imu(load_robot(config.robot), config.imu_site) if point is None else point.description
    clock = RobotClock()
    injector = Injector(injections, clock)
    policy, suited = _policy_on_robot(config, description, injector)
    if point is None:
        description = _checked_poses(suited) if config.check_poses else suited
    contract, is_shadow = policy.contract, config.shadow is not None
    refuse_without_effect(config, contract, description)
    if point is None:
        control_period, notice = control_rate(
            config, description, None if is_shadow or contract is None else contract.policy_dt
        )
    else:
        control_period, notice = point.recording.header.control_period, ""
    setup = _robot(config, description, control_period, contract)
    try:
        taken: Mapping[str, int] = {} if policy.loaded is None else policy.loaded.taken(setup.live)
        refuse_unheard_keys(config, taken, setup.live)
        live = {**taken, **setup.live, VELOCITY_COMMAND: EXTERN_WIDTHS[VELOCITY_COMMAND]}
        limit, shadow = config.action_limit, None
        signs = _allowed_signs(config, setup)
        # Without a policy and REMOTE, the FSM itself keeps the robot in DAMPING and STANDBY.
        if is_shadow and policy.loaded is not None:
            supervisor = build_supervisor(description, control_period, None, signs=signs)
            shadow = policy_controller(description, control_period, policy.loaded, live=live, action_limit=limit)
        else:
            supervisor = build_supervisor(
                description,
                control_period,
                policy.loaded,
                remote=True,
                live=live,
                action_limit=limit,
                signs=signs,
                loads=True,
            )
        warnings = () if contract is None else setup.check_policy(contract)
        pads = look_for_gamepad(config)
        branch = None if point is None or contract is None else reach(point, setup, supervisor, contract, clock)
        if steps is None and not config.manual and config.hardware is None and branch is None:
            steps = parse_script(_automatic_script(config, policy.motion))
        ranges = None if contract is None else contract.command_ranges
        command = parse_velocity(config.command, ranges)
        if branch is not None and branch.velocity is not None and not config.is_given("command"):
            command = branch.velocity
        velocity = VelocityCommand(command, ranges)
        velocity.is_observed = policy.walks
        if branch is not None:
            branch.inputs.velocity, branch.inputs.leaves_velocity = velocity, config.is_given("command")
        drivers = (*_who_drives(config, steps, walks=policy.walks), *_who_feeds(config, steps, taken, contract))
        drivers = drivers if branch is None or config.manual else ()
        texts = (
            *(() if branch is None else branch.notices),
            notice,
            *setup.notices,
            describe_unwatched(description),
            *warnings,
            _cost_of_plant(config, policy, description),
            *policy_notices(policy),
            *pads,
            *drivers,
        )
        return Plan(
            config=config,
            description=description,
            policy=policy,
            control_period=control_period,
            realtime=_realtime(config),
            setup=setup,
            supervisor=supervisor,
            shadow=shadow,
            steps=steps,
            taken=taken,
            velocity=velocity,
            branch=branch,
            injector=injector,
            clock=clock,
            outputs=Outputs() if config.dry_run else choose_outputs(config, _inputs(config, policy)),
            front_ends=() if config.dry_run else with_keyboard(front_ends, setup.keyboard),
            notices=tuple(text for text in texts if text),
        )
    except BaseException:
        setup.release()
        raise


def _allowed_signs(config: PlayConfig, setup: RobotSetup) -> tuple[str, ...] | None:
    """Return the joints whose sign may contradict gravity; None where signs are not judged."""
    for name in config.allow_sign_contradiction:
        if name not in setup.robot.joints:
            raise InputError(f"--allow-sign-contradiction: {known_names('joint', name, setup.robot.joints)}")
    return None if setup.levers is None else tuple(dict.fromkeys(config.allow_sign_contradiction))


def _checked_poses(description: RobotDescription) -> RobotDescription:
    """Return the robot that walks through its check poses."""
    extended = with_check_poses(description)
    for problem in check_pose_problems(description):
        raise InputError(f"--check-poses: {problem}")
    return extended


def policy_notices(policy: PolicyChoice) -> tuple[str, ...]:
    """List what to know about a policy, whatever robot it drives, one line each."""
    if policy.checkpoint is None:
        return ()
    golden = policy.checkpoint.golden
    return (
        *assumptions(policy.checkpoint.contract),
        *policy.notices,
        *((f"golden vectors: {golden}",) if golden else ()),
    )


def _inputs(config: PlayConfig, policy: PolicyChoice) -> tuple[Path, ...]:
    """Return the files that the run reads."""
    branched = None if config.branch is None else parse_branch(config.branch)[0]
    named = (config.checkpoint, config.contract, config.again, branched, config.robot, config.calibration)
    return (*(Path(name) for name in named if name is not None and is_file(name)), *filter(None, [policy.motion_file]))


def _policy_on_robot(
    config: PlayConfig, description: RobotDescription, injector: Injector
) -> tuple[PolicyChoice, RobotDescription]:
    """Return the policy, and the robot with what it takes from the policy's contract."""
    is_default = config.robot == DEFAULT_ROBOT and config.checkpoint is not None
    hint = f"--robot: the default, '{DEFAULT_ROBOT}', is used, and this policy is for another robot: "
    own = [name for name in shipped("robots") if sample_policy(name) == checkpoint_path(config)]
    hint += f"add --robot {own[0]}; " if own else "name its MJCF or YAML file; "
    try:
        policy = choose_policy(config, description, injector.policy)
    except InputError as error:
        count = _count_of_places(config) if is_default else None
        if count is None:
            raise
        has = f"; the policy has {count} joints, the default robot '{DEFAULT_ROBOT}' {description.joint_count}"
        raise InputError(f"{hint}{error}{f'{has}: give --robot' if count else ''}") from None
    contract = policy.contract
    if (contract is None or config.shadow is not None) and description.has_no_gains:
        option = "--policy none" if contract is None else "--shadow"
        raise InputError(f"{option}: '{description.name}' has no gains of its own to stand by, expected a robot's YAML")
    if contract is None:
        return policy, description
    try:
        resolve_action(contract, description.joint_names)
    except FieldError as error:
        problem = f"policy on robot '{description.name}': {error}"
        raise InputError(f"{hint if is_default else ''}{problem}") from None
    if config.shadow is not None:
        return policy, description  # as it is without the policy
    change = with_contract if description.has_no_gains else with_contract_physics
    return policy, change(description, contract)


def _count_of_places(config: PlayConfig) -> int | None:
    """Return the joints of a policy that gives them by their places on its robot, 0 where their number is not known.

    None for any other policy: one by places any other robot cannot but refuse.
    """
    try:
        read_contract(checkpoint_path(config) or Path(), None if config.contract is None else Path(config.contract))
    except UnnamedJointsError as error:
        return error.count
    except InputError:
        return None
    return None


def _robot(
    config: PlayConfig, description: RobotDescription, control_period: float, contract: PolicyContract | None
) -> RobotSetup:
    if config.hardware is None:
        return simulated_robot(config, description, control_period, contract)
    # python-can and pyserial only where they are used
    from humanoid_sim.play.hardware_robot import real_robot  # noqa: PLC0415

    return real_robot(config, description, control_period)


def _cost_of_plant(config: PlayConfig, policy: PolicyChoice, description: RobotDescription) -> str:
    """Say what an approximate plant costs in truth on this robot and motion; '' of an exact one, and of hardware."""
    if config.hardware is not None or config.actuation != "implicit" or policy.checkpoint is None:
        return ""
    # Only who chooses such a plant waits for the measurement and its imports.
    from humanoid_sim.plants import measured_cost  # noqa: PLC0415

    return measured_cost(policy.checkpoint, description, policy.motion, config.actuation, config.physics_timestep)


def _who_drives(config: PlayConfig, steps: Sequence[ScriptStep] | None, *, walks: bool) -> tuple[str, ...]:
    """Give the keys of an operator at the keyboard; where nobody and no script drives, how to do it from elsewhere."""
    if has_keys(config):
        return (key_help(), velocity_key_help()) if walks else (key_help(),)
    if steps is not None or config.dry_run:
        return ()
    if config.manual:
        return (f"no terminal to read keys from: waits for an operator at {' or '.join(operated_by(config))}",)
    return ("waits for an operator in another terminal: python -m humanoid_sim.mode damp, load_a, start_locomotion",)


def _who_feeds(
    config: PlayConfig, steps: Sequence[ScriptStep] | None, taken: Iterable[str], contract: PolicyContract | None
) -> tuple[str, ...]:
    """Return what has to come from other programs, and does not come from one that this run starts."""
    notices = []
    if config.remote == "none" and any(step.intent is Intent.START_REMOTE for step in steps or ()):
        notices.append("nothing that this run starts sends commands for REMOTE: it damps until a producer attaches")
    topics = {name: live_topic(contract, name) for name in taken if name != KEY_PRESSED}
    names = ", ".join(f"{name} ({topic.name})" for name, topic in topics.items() if topic is not None)
    if names:
        notices.append(f"the policy observes {names}, which a program has to send: docs/front-ends.md says how")
    if KEY_PRESSED in taken and config.midi is None:
        notices.append("which keys are down has to come from a program: --midi takes it from a MIDI keyboard")
    return tuple(notices)


def _realtime(config: PlayConfig) -> bool:
    """Return whether somebody, or a thread or a bus that lives in real time, takes part."""
    if config.hardware is not None:
        return True
    if config.pace != "auto":
        return config.pace == "realtime"
    return config.manual or bool(wanted_front_ends(config))


_OPEN_END = 10.0
"""s that a policy without a motion runs when nothing else ends the run."""


def _automatic_script(config: PlayConfig, motion: Motion | None) -> str:
    """Return the script that plays when nobody drives: long enough in each mode to see it."""
    run = "motion; hold 0.5" if motion is not None else f"hold {config.duration or _OPEN_END}"
    if motion is not None and config.shadow is not None:
        run = f"hold {motion.duration + 0.5}"
    if config.policy_seconds is not None:
        run = f"hold {config.policy_seconds}"
    start = "start_remote; " if config.remote != "none" else "start_locomotion; "
    if config.shadow is not None or not (config.has_policy or config.remote != "none"):
        start = ""
    run = f"hold {config.duration or _OPEN_END}" if config.remote != "none" else run
    return f"hold 0.5; damp; hold 1; load_{config.pose}; wait; hold 0.2; {start}{run}; damp; hold 1"


def expected_duration(config: PlayConfig, policy: PolicyChoice, description: RobotDescription) -> float | None:
    """About how long the run takes, s on the robot's clock; None if only its driver knows."""
    if config.duration is not None:
        return config.duration
    if config.manual or config.script is not None or config.hardware is not None or config.branch is not None:
        return None
    standby = description.standby_controller_a if config.pose == "a" else description.standby_controller_b
    motion = _OPEN_END if policy.motion is None or config.remote != "none" else policy.motion.duration
    runs = motion + 0.5 if config.policy_seconds is None else config.policy_seconds
    return 0.5 + 1.0 + sum(standby.segment_durations) + 0.2 + runs + 1.0


def control_rate(config: PlayConfig, description: RobotDescription, policy_dt: float | None) -> tuple[float, str]:
    """Return the control period, and what to tell the user if it is not the robot's own.

    Where the policy's period is not a multiple of the control period, the control rate moves to the nearest that is. On
    hardware there is no physics step to divide it.

    Returns:
        Control period in s, and a notice or ''.

    Raises:
        InputError: if the physics step does not divide the control period, or the policy's period has too many ticks.
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
    timestep = timestep_of(description, config.actuation, config.physics_timestep)
    try:
        steps_per_period(period, timestep, step_name="--physics-timestep")
    except InputError as error:
        raise InputError(f"{error}; {notice}" if notice else str(error)) from None
    return period, notice
