"""The policy that `play` runs, and its motion: those that options name, or those of a recording to play again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from humanoid_sim.assets import SAMPLE_MOTION, SAMPLE_SONG, motion_path, policy_path, sample_policy, shipped, song_path
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.policy_step import resolve_action
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.play.options import NO_POLICY, PlayConfig
from humanoid_sim.policy.checkpoint import (
    PLACEHOLDER,
    Checkpoint,
    load_checkpoint,
    placeholder_checkpoint,
    read_contract,
    zero_policy,
)
from humanoid_sim.policy.describe import assumptions
from humanoid_sim.policy.loaded_policy import LoadedPolicy, load_policy
from humanoid_sim.policy.motion import Motion, read_motion
from humanoid_sim.policy.onnx_policy import has_onnxruntime
from humanoid_sim.policy.song import load_song, song_motion
from humanoid_sim.robots.description import RobotDescription, load_robot, with_contract, with_contract_physics


@dataclass(frozen=True, slots=True)
class PolicyChoice:
    """The policy of a run, and what the user must know about it."""

    loaded: LoadedPolicy | None = None
    """None in a run without a policy."""
    checkpoint: Checkpoint | None = None
    motion: Motion | None = None
    motion_file: Path | None = None
    warning: str = ""
    notices: tuple[str, ...] = ()
    others: tuple[PolicyChoice, ...] = ()
    """Further policies that can be selected in the session."""

    @property
    def choices(self) -> tuple[PolicyChoice, ...]:
        """This policy and the others; empty in a run without."""
        return () if self.loaded is None else (self, *self.others)

    @property
    def contracts(self) -> tuple[PolicyContract, ...]:
        """Contracts of all."""
        return tuple(choice.loaded.contract for choice in self.choices if choice.loaded is not None)

    @property
    def named(self) -> Mapping[str, LoadedPolicy]:
        """The policies by name where there are several: their files' names without .onnx."""
        choices = self.choices if self.others else ()
        return {choice.name: choice.loaded for choice in choices if choice.loaded is not None}

    @property
    def contract(self) -> PolicyContract | None:
        """Contract of the policy; None without one."""
        return None if self.loaded is None else self.loaded.contract

    @property
    def name(self) -> str:
        """Name by which it is selected."""
        return Path(self.source).stem

    @property
    def source(self) -> str:
        """Name for operators: its file, or `none`."""
        return NO_POLICY if self.checkpoint is None else self.checkpoint.source

    @property
    def label(self) -> str:
        """The policies, and the motions that they follow."""
        own = self.source if self.motion_file is None else f"{self.source}, motion {self.motion_file.name}"
        return "; ".join([own, *(other.label for other in self.others)])

    @property
    def settings(self) -> dict[str, Any]:
        """Fields of a recording's settings."""
        return {
            "policy": None if self.checkpoint is None else self.checkpoint.source,
            "policy_sha256": None if self.checkpoint is None else self.checkpoint.sha256,
            "motion": None if self.motion_file is None else str(self.motion_file),
            **({"policies": {one.name: one.settings for one in self.others}} if self.others else {}),
        }

    @property
    def motion_frames(self) -> int:
        """Length of the motion in policy steps; 0 for none."""
        return 0 if self.motion is None else len(self.motion.frames)

    def external_inputs(self, reported: Mapping[str, int]) -> dict[str, int]:
        """Return name and width of the live inputs that have to come from other programs; the robot reports some."""
        found: dict[str, int] = {}
        for choice in self.choices:
            if choice.loaded is not None:
                found |= choice.loaded.live_inputs(reported)
        return found

    @property
    def walks(self) -> bool:
        """Return True if one of them takes a velocity command."""
        return any(contract.takes_velocity_command for contract in self.contracts)


def checkpoint_path(name: str | None) -> Path | None:
    """Return the file of a checkpoint that an option names; None for the sample policy, the placeholder and none."""
    if name in (None, PLACEHOLDER, NO_POLICY):
        return None
    return policy_path(name or "", also=(PLACEHOLDER, NO_POLICY))


def choose_policy(config: PlayConfig, description: RobotDescription) -> PolicyChoice:
    """Load the checkpoints and the motions that the options name: all before the session begins."""
    if not config.has_policy:
        return PolicyChoice()
    chosen = [_choose_one(config, description, name) for name in config.policy or (None,)]
    names = [choice.name for choice in chosen]
    if len(set(names)) < len(names):
        raise InputError(f"--policy: {', '.join(names)} are not different names, expected files with a name each")
    return replace(chosen[0], others=tuple(chosen[1:]))


def _choose_one(config: PlayConfig, description: RobotDescription, name: str | None) -> PolicyChoice:
    """Load one checkpoint and its motion."""
    path = checkpoint_path(name) or sample_policy(description.name)
    contract_file = None if config.contract is None else Path(config.contract)
    warning = ""
    if name == PLACEHOLDER:
        checkpoint = placeholder_checkpoint(description, "a")
        warning = "PLACEHOLDER POLICY: no network runs; the action is zero, and the arms hold one pose"
    elif has_onnxruntime():
        checkpoint = load_checkpoint(path, contract_file, description.joint_names)
        if config.hardware is not None:  # a fault, and so DAMPING, while the motors still listen
            checkpoint.limit_inference(0.5 * config.can_timeout)
    else:
        contract = read_contract(path, contract_file, description.joint_names)
        checkpoint = Checkpoint(contract, zero_policy(contract.action_count), str(path))
        warning = (
            f"PLACEHOLDER POLICY: onnxruntime cannot be imported, so {path.name} does NOT run; "
            "the action is zero. To run it: pip install onnxruntime"
        )
    motion, file, notices = _chosen_motion(config, checkpoint, description, name)
    loaded = load_policy(
        checkpoint.contract,
        checkpoint.policy,
        motion,
        checkpoint.observation_width,
        source=checkpoint.source,
        motion_source=str(file),
    )
    return PolicyChoice(loaded, checkpoint, motion, file, warning, notices)


def choose_for_robot(config: PlayConfig, description: RobotDescription) -> tuple[PolicyChoice, RobotDescription]:
    """Return the policy, chosen by `choose_policy`, and the robot with what it takes from the policy's contract."""
    policy = choose_policy(config, description)
    contract = policy.contract
    if contract is None:
        if description.has_no_gains:
            raise InputError(
                f"--policy none: '{description.name}' has no gains of its own to stand by, expected a robot's YAML"
            )
        return policy, description
    for one in policy.contracts:
        require_joints(one, description)
    change = with_contract if description.has_no_gains else with_contract_physics
    return policy, change(description, contract)


def require_joints(contract: PolicyContract, description: RobotDescription) -> None:
    """Refuse a policy whose joints the robot does not have."""
    try:
        resolve_action(contract, description.joint_names)
    except FieldError as error:
        fitting = [name for name in shipped("robots") if contract.joint_names == load_robot(name).joint_names]
        hint = f"it fits --robot {fitting[0]}; " if fitting else ""
        raise InputError(f"--robot: {hint}policy on robot '{description.name}': {error}") from None


def policy_notices(policy: PolicyChoice) -> tuple[str, ...]:
    """List what to know about a policy, whatever robot it drives, one line each."""
    if policy.checkpoint is None:
        return ()
    golden = policy.checkpoint.golden
    if not golden and not policy.warning and not policy.checkpoint.contract.live_inputs:
        golden = "none, so nothing proves that the policy is wired here as it was trained"
    reading = policy.checkpoint.reading
    return (
        *(f"{values}: {source}" for source, values in assumptions(policy.checkpoint.contract).items()),
        *(f"not used: {line}" for line in ([] if reading is None else reading.unused)),
        *policy.notices,
        *((f"golden vectors: {golden}",) if golden else ()),
    )


def _chosen_motion(
    config: PlayConfig, checkpoint: Checkpoint, description: RobotDescription, name: str | None
) -> tuple[Motion | None, Path | None, tuple[str, ...]]:
    """Return the motion, the file that it is from, and what to tell about it."""
    contract, source = checkpoint.contract, checkpoint.source
    task, path = contract.task_type, checkpoint_path(name)
    ships = name is None or (path is not None and str(path) != name)
    if len(config.policy) > 1:  # --motion and --song are for those that follow one
        config = replace(
            config,
            song=config.song if task == "piano" else None,
            motion=None if task == "locomotion" or checkpoint.motion is not None else config.motion,
        )
    if config.song is not None and task != "piano":
        raise InputError(f"--song: is '{config.song}', but {source} is a {task} policy")
    if config.motion is not None and task == "locomotion":
        raise InputError(f"--motion: is '{config.motion}', but {source} follows no motion")
    if task == "piano" and config.motion is None:
        if config.song is None and not ships:
            raise InputError(f"--song: is missing; {source} is a piano policy")
        return _song(config.song or SAMPLE_SONG, contract.policy_dt, description)
    if config.motion is None and (task == "locomotion" or checkpoint.motion is not None):
        return checkpoint.motion, None, ()
    if config.motion is None and not ships:
        dataset = contract.dataset_repo_id
        hint = f"; its default is the dataset '{dataset}', to be converted to an .mcap motion first" if dataset else ""
        raise InputError(f"--motion: is missing; {source} is a {task} policy and follows a motion{hint}")
    file = motion_path(config.motion or SAMPLE_MOTION)
    return read_motion(file), file, ()


def _song(name: str, policy_dt: float, description: RobotDescription) -> tuple[Motion, Path, tuple[str, ...]]:
    """Return a song as `_chosen_motion` returns a motion."""
    song = load_song(name, description)
    why = "left out of the song, beyond reach or more notes at a time than fingers"
    notes = (f"{why}: {song.names_left_out}",) if song.left_out else ()
    return song_motion(song, policy_dt, description), song_path(name), notes
