"""Scenario of an environment, whatever steps it: a robot, a policy, the motion that it follows, and a task."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from humanoid_sim import mit
from humanoid_sim.assets import motion_path, policy_path, sample_songs
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.guards import Guards
from humanoid_sim.controllers.live_inputs import LiveInput, LiveInputs
from humanoid_sim.controllers.policy_step import Policy, PolicyWiring
from humanoid_sim.controllers.reference import MotionReference
from humanoid_sim.envs.reference_states import ReferenceStates, reference_states
from humanoid_sim.envs.tasks import TASK_OPTIONS, Task, make_task
from humanoid_sim.envs.tasks.task import Start
from humanoid_sim.errors import InputError, blaming, known_names
from humanoid_sim.mit import FloatArray, IndexArray, point_velocity
from humanoid_sim.policy.checkpoint import Checkpoint, load_checkpoint, zero_policy
from humanoid_sim.policy.layers import join
from humanoid_sim.policy.loaded_policy import LoadedPolicy
from humanoid_sim.policy.motion import Motion, read_motion
from humanoid_sim.policy.readers.own import read_contract_file
from humanoid_sim.policy.reading import required_contract
from humanoid_sim.policy.song import named_song, song_motion
from humanoid_sim.robots.description import RobotDescription, load_robot, with_contract, with_joint_limits
from humanoid_sim.robots.guards import guards_of
from humanoid_sim.robots.piano import KEY_COUNT
from humanoid_sim.simulation.floating_base import StartPose
from humanoid_sim.simulation.model import build_model, joint_addresses
from humanoid_sim.simulation.plant import Actuation, check_actuation, timestep_of

Named = str | Path
"""The name of a file that ships with the package, or a path."""
Motions = Named | Motion | Sequence[Named | Motion]
"""One motion, or several."""

_MOST = float(np.finfo(np.float32).max)
"""Largest action limit: an action of float32 that is infinite must be beyond it."""


@dataclass(frozen=True, slots=True, eq=False)
class Scenario:
    """Parts of an environment that do not depend on how many robots there are."""

    description: RobotDescription
    """The robot, with the contract's gains, in the contract's default pose."""
    wiring: PolicyWiring
    """Observations and commands of the policy, by the functions of the deployed controller."""
    task: Task
    policy: Policy
    """The checkpoint's; one that answers zeros where there is only a contract."""
    physics_timestep: float
    """s"""
    actuation: Actuation
    """Simulation of the motors."""
    live: LiveInputs
    """Source of the live inputs that the contract declares."""
    starts: EpisodeStarts
    """Beginnings of episodes."""
    contract_as_read: PolicyContract
    """Contract of the policy, before the robot's own limits went into it."""
    motion: Motions | None = None
    """Motion that the policy was given to follow, songs as the goals that they came to; None: nothing."""
    guards: Guards | None = None
    """Guards of the deployed control stack, which end an episode as they end LOCOMOTION there."""

    @property
    def contract(self) -> PolicyContract:
        """Return the policy's contract."""
        return self.wiring.contract

    @property
    def bodies(self) -> tuple[str, ...]:
        """Bodies whose poses in the base frame the task looks at: those of the motion, then those of the task."""
        tracked = self.contract.body_names if "motion_body_pos_b" in self.wiring.reference.terms else ()
        return (*tracked, *self.task.bodies)

    @property
    def velocity_points(self) -> tuple[str, ...]:
        """Return where the velocity of a floating base's robot is told: for the policy, and for the task."""
        return tuple(dict.fromkeys((*self.contract.velocity_points, *self.task.bodies)))

    def robot_options(self) -> dict[str, Any]:
        """Return the options of simulated robots, one or a batch, that the scenario decides."""
        return {
            "control_period": self.contract.policy_dt,
            "physics_timestep": self.physics_timestep,
            "actuation": self.actuation,
            "anchor_body": self.contract.anchor_body,
            "velocity_at": self.velocity_points,
            "height_scan": self.contract.height_scan,
            "bodies": self.bodies,
        }


def make_scenario(
    contract: Named | PolicyContract | Checkpoint,
    robot: Named | RobotDescription,
    motion: Motions | None = None,
    *,
    task: str | type[Task] = "auto",
    physics_timestep: float | None = None,
    actuation: Actuation = "affine",
    action_limit: float | None = None,
    motion_source: str = "motion",
    live: Mapping[str, LiveInput] | None = None,
    guards: bool = True,
    reference_start: float = 0.0,
    **task_options: Any,
) -> Scenario:
    """Read what is named, and check that it fits together.

    Raises `InputError` for what cannot be read, or does not fit.

    Args:
        contract: of the policy, as `read_policy` takes it.
        robot: a description, or what `load_robot` takes.
        motion: what the policy follows, as `read_policy` takes it; a piano policy also a sample song or a MIDI file; or
            several, of which each episode has one.
        task: as `make_task` takes it.
        physics_timestep: s; None for what suits robot and plant.
        actuation: how the motors are simulated, see `humanoid_sim.simulation.plant`.
        action_limit: largest magnitude of a raw action, beyond which the policy has failed; None: the contract's,
            or 100.
        motion_source: what to call a motion that is given itself.
        live: by its name, what makes each live input that the contract declares: of an `MITState` a value of shape
            (..., width).
        guards: whether the guards of the robot's description watch the joints.
        reference_start: share of the episodes that begin at a random frame of the motion, in the motion's own state.
        task_options: `weights`, `episode_seconds`, `joint_noise`, `velocity_noise` and `rewards`, as `Task` takes them.
    """
    if action_limit is not None and not 0.0 < action_limit <= _MOST:
        raise InputError(f"action_limit: is {action_limit}, expected a number > 0 and at most {_MOST:g}")
    check_actuation(actuation)
    if task_options:
        check_options(task_options, make_scenario)
    described = robot if isinstance(robot, RobotDescription) else load_robot(robot)
    checkpoint = checkpoint_of(contract, described.joint_names)
    followed = with_songs(motion, checkpoint.contract, described)
    loaded = read_policy(checkpoint, followed, described.joint_names, motion_source)
    read = with_joint_limits(loaded.contract, described)
    description = with_contract(described, read)
    points = [point_velocity(point) for point in (mit.BASE, *read.velocity_points)] if description.is_floating else []
    told = {mit.VELOCITY_COMMAND, *points, mit.HEIGHT_SCAN, *([mit.ANCHOR_POSE] if read.anchor_body else [])}
    extern = {name: width for name, width in read.extern_widths.items() if name in told}
    if description.piano is not None:
        extern[mit.KEY_PRESSED] = KEY_COUNT
    with blaming(f"policy on robot '{description.name}'"):
        fed = LiveInputs(read, {} if live is None else dict(live))
        extern |= fed.widths
        wiring = PolicyWiring(description.joint_names, read, loaded.reference, extern, action_limit)

    timestep = timestep_of(description, actuation, physics_timestep)
    model = build_model(description, physics_timestep=timestep, scene="floor")
    start = StartPose(model, description, joint_addresses(model, description.joint_names))
    made = make_task(task, description, read, loaded.reference, standing_height=start.standing_height, **task_options)
    return Scenario(
        description=description,
        wiring=wiring,
        task=made,
        policy=loaded.policy,
        physics_timestep=timestep,
        actuation=actuation,
        live=fed,
        contract_as_read=loaded.contract,
        motion=followed,
        guards=guards_of(description) if guards else None,
        starts=EpisodeStarts(
            made,
            loaded.reference,
            reference_start,
            _states(description, read, loaded.reference, reference_start),
            turns=read.align_reference and mit.ANCHOR_POSE in told,
        ),
    )


def _states(
    description: RobotDescription, contract: PolicyContract, reference: MotionReference, share: float
) -> ReferenceStates | None:
    """Return where episodes begin in a motion's middle, if any do."""
    if not (isinstance(share, int | float) and 0.0 <= share <= 1.0):
        raise InputError(f"reference_start: is {share!r}, expected a number from 0 to 1")
    states = reference_states(description, contract, reference) if share else None
    if share and states is None:
        raise InputError(f"reference_start: is {share:g}, but the policy follows no motion with joints")
    return states


def with_songs(motion: Motions | None, contract: PolicyContract, robot: RobotDescription) -> Motions | None:
    """Return the motions with goals in the place of songs: samples, and MIDI files, as far as the robot plays them."""
    if contract.task_type != "piano" or motion is None or isinstance(motion, Motion):
        return motion
    if isinstance(motion, str | Path):
        name = str(motion)
        if name not in sample_songs() and not name.endswith((".mid", ".midi")):
            return motion
        song, _ = named_song(name, robot, what="motion")
        return song_motion(song, contract.policy_dt, robot)
    several: list[Named | Motion] = []
    for one in motion:
        made = with_songs(one, contract, robot)
        assert isinstance(made, str | Path | Motion)
        several.append(made)
    return several


def read_policy(
    source: Named | PolicyContract | Checkpoint,
    motion: Motions | None,
    joints: tuple[str, ...],
    motion_source: str = "motion",
) -> LoadedPolicy:
    """Return a policy with the motion, or the motions, that it follows, checked against each other.

    Raises `InputError` for what cannot be read, or does not fit.

    Args:
        source: a checkpoint, a contract, or the name or path of a checkpoint or a contract file. Where there is no
            checkpoint the policy answers zeros.
        motion: a sample motion by name, a file by path, or the motion itself, or several of these; None for the one
            that a checkpoint carries in its graph, and for policies that follow none.
        joints: of the robot, in its order.
        motion_source: what to call a motion that is given itself.
    """
    checkpoint = checkpoint_of(source, joints)
    if motion is not None and not isinstance(motion, str | Path | Motion):
        if not motion:
            raise InputError("motion: is an empty list, expected a motion or several")
        if checkpoint.motion is not None:
            raise InputError(f"motion: is a list, and {checkpoint.source} carries its own in its graph, expected one")
        loaded = [read_policy(checkpoint, one, joints, f"{motion_source}[{i}]") for i, one in enumerate(motion)]
        with blaming("motion"):
            return replace(loaded[0], reference=MotionReference.joined([one.reference for one in loaded]))
    contract, followed = checkpoint.contract, checkpoint.motion
    what = motion_source if isinstance(motion, Motion | None) else str(motion)
    if isinstance(motion, str | Path):
        try:
            followed = read_motion(motion_path(what))
        except InputError as error:  # which names the option of `play`
            raise InputError(str(error).removeprefix("--")) from None
    elif motion is not None:
        followed = motion
    if contract.task_type == "locomotion":
        if motion is not None:
            raise InputError(f"motion: is '{what}', but {checkpoint.source} follows no motion")
    elif followed is None:
        raise InputError(f"motion: is missing; {checkpoint.source} is a {contract.task_type} policy and follows one")
    return checkpoint.following(followed, what)


def checkpoint_of(source: Named | PolicyContract | Checkpoint, joints: tuple[str, ...]) -> Checkpoint:
    """Return a checkpoint, or a contract with a policy that answers zeros; arguments and errors as of `read_policy`."""
    if isinstance(source, Checkpoint):
        return source
    if isinstance(source, PolicyContract):
        return Checkpoint(source, zero_policy(source.action_count), "contract")
    path = policy_path(source, "policy", contracts=True)
    if path.suffix == ".onnx":
        return load_checkpoint(path, None, joints)
    if path.suffix not in (".yaml", ".yml"):
        raise InputError(f"policy: is '{source}', expected a checkpoint (.onnx) or a contract (.yaml)")
    contract = required_contract(join([read_contract_file(path)], str(path)), path)
    return Checkpoint(contract, zero_policy(contract.action_count), str(path))


@dataclass(frozen=True, slots=True, eq=False)
class EpisodeStarts:
    """Starts of episodes by random numbers that a caller hands in, for one robot or many."""

    task: Task
    reference: MotionReference
    """One motion or several, of which each episode has one."""
    reference_start: float = 0.0
    """Share of the episodes that begin at a random frame of the motion, in the motion's own state."""
    states: ReferenceStates | None = None
    """States at all frames, where some episodes begin there."""
    turns: bool = False
    """True where a motion in the world may have any heading: its policy lays it onto the robot."""

    @property
    def draws(self) -> int:
        """Random numbers that a start takes."""
        return self.task.draws + self._motion_draws

    @property
    def _motion_draws(self) -> int:
        return (len(self.reference.lengths) > 1) + 2 * (self.reference_start > 0.0)

    def __call__(self, numbers: FloatArray) -> Start:
        """Return the start that uniform random numbers in [0, 1), shape (..., draws), stand for."""
        numbers, of_motion = numbers[..., : self.task.draws], numbers[..., self.task.draws :]
        if not self._motion_draws:
            return self.task.start(numbers)
        lengths = np.array(self.reference.lengths or (self.reference.frame_count,))
        chosen = np.zeros(numbers.shape[:-1], dtype=np.intp)
        if len(lengths) > 1:
            chosen = np.asarray(np.floor(of_motion[..., 0] * len(lengths)).astype(np.intp))
        frame: IndexArray = (np.cumsum(lengths) - lengths)[chosen]
        if self.states is None or not self.reference_start:
            return replace(self.task.start(numbers), frame=frame)
        is_inside = of_motion[..., -2] < self.reference_start
        # not the last frame, after which the episode would be over
        inside = np.floor(of_motion[..., -1] * np.maximum(lengths[chosen] - 1, 1)).astype(np.intp)
        frame = np.where(is_inside, frame + inside, frame)
        around = (self.states.joint_position[frame], self.states.joint_velocity[frame], is_inside)
        start = replace(self.task.start(numbers, around), frame=frame)
        base = self.states.base_at(frame, start.base_yaw if self.turns else np.zeros_like(start.base_yaw))
        if base is None:
            return start
        pose, velocity = base
        return replace(start, base_pose=np.where(is_inside[..., None], pose, np.nan), base_velocity=velocity)


def check_options(given: Iterable[str], *takers: Callable[..., Any]) -> None:
    """Refuse an option that neither an environment nor its task has.

    Raises `InputError` naming the nearest option, or all where none is near.

    Args:
        given: names of options that a signature does not list.
        takers: whose signatures list the other options.
    """
    own = [
        name
        for taker in takers
        for name, parameter in inspect.signature(taker).parameters.items()
        if parameter.kind is not inspect.Parameter.VAR_KEYWORD
    ]
    known = tuple(dict.fromkeys([*own, *TASK_OPTIONS]))
    for name in given:
        if name not in known:
            raise InputError(known_names("option", name, known))
