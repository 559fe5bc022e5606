"""The policies that `play` runs, and the motions that they follow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from humanoid_sim.assets import SAMPLE_MOTION, SAMPLE_SONG, motion_path, policy_path, sample_policy, song_path
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.policy_step import resolve_action
from humanoid_sim.errors import InputError, blaming
from humanoid_sim.play.options import NO_POLICY, PlayConfig
from humanoid_sim.policy.checkpoint import (
    PLACEHOLDER,
    Checkpoint,
    load_checkpoint,
    placeholder_checkpoint,
    read_contract,
    zero_policy,
)
from humanoid_sim.policy.findings import assumptions
from humanoid_sim.policy.loaded_policy import LoadedPolicy
from humanoid_sim.policy.motion import Motion, read_motion
from humanoid_sim.policy.onnx_policy import has_onnxruntime
from humanoid_sim.policy.song import load_song, song_motion
from humanoid_sim.robots.description import RobotDescription, with_contract, with_contract_physics


@dataclass(frozen=True, slots=True)
class PolicyChoice:
    """A policy, the motion that it follows, and what the user must know about it."""

    loaded: LoadedPolicy
    checkpoint: Checkpoint
    motion_file: Path | None
    warning: str
    notices: tuple[str, ...]

    @property
    def name(self) -> str:
        """Name by which it is selected: its file's, without .onnx."""
        return Path(self.checkpoint.source).stem

    @property
    def label(self) -> str:
        source, file = self.checkpoint.source, self.motion_file
        return source if file is None else f"{source}, motion {file.name}"

    @property
    def settings(self) -> dict[str, Any]:
        motion = None if self.motion_file is None else str(self.motion_file)
        return {"policy": self.checkpoint.source, "policy_sha256": self.checkpoint.sha256, "motion": motion}


@dataclass(frozen=True, slots=True)
class Policies:
    """The policies of a run; the first is selected at the start. None of them in a run without."""

    choices: tuple[PolicyChoice, ...] = ()

    @property
    def first(self) -> PolicyChoice | None:
        return self.choices[0] if self.choices else None

    @property
    def contracts(self) -> tuple[PolicyContract, ...]:
        return tuple(choice.loaded.contract for choice in self.choices)

    @property
    def loaded(self) -> LoadedPolicy | Mapping[str, LoadedPolicy] | None:
        """The only one, or all by name."""
        if len(self.choices) > 1:
            return {choice.name: choice.loaded for choice in self.choices}
        return self.first.loaded if self.first else None

    @property
    def walks(self) -> bool:
        """True if one of them takes a velocity command."""
        return any(contract.takes_velocity_command for contract in self.contracts)

    @property
    def label(self) -> str:
        return "; ".join(choice.label for choice in self.choices) or NO_POLICY

    @property
    def settings(self) -> dict[str, Any]:
        if self.first is None:
            return {"policy": None, "policy_sha256": None, "motion": None}
        others = {one.name: one.settings for one in self.choices[1:]}
        return self.first.settings | ({"policies": others} if others else {})

    @property
    def live_timeouts(self) -> dict[str, float]:
        """Time in s after which a live input counts no more, of those that state one, by name."""
        topics = [item for contract in self.contracts for item in contract.live_topics.items()]
        return {name: topic.timeout for name, topic in topics if topic.timeout is not None}

    def external_inputs(self, reported: Mapping[str, int]) -> dict[str, int]:
        """Return name and width of the live inputs that have to come from other programs; the robot reports some."""
        return dict(item for choice in self.choices for item in choice.loaded.live_inputs(reported).items())


def choose_policies(config: PlayConfig, description: RobotDescription) -> tuple[Policies, RobotDescription]:
    """Load the checkpoints and the motions that the options name; return them, and the robot as it goes with them."""
    if not config.has_policy:
        if description.has_no_gains:
            robot = description.name
            raise InputError(f"--policy none: '{robot}' has no gains of its own to stand by, expected a robot's YAML")
        return Policies(), description
    choices = tuple(_choose(config, description, name) for name in config.policy or (None,))
    names = [choice.name for choice in choices]
    if len(set(names)) < len(names):
        raise InputError(f"--policy: {', '.join(names)} are not different names, expected files with a name each")
    for choice in choices:
        with blaming(f"--robot: policy on robot '{description.name}'"):
            resolve_action(choice.loaded.contract, description.joint_names)
    change = with_contract if description.has_no_gains else with_contract_physics
    return Policies(choices), change(description, choices[0].loaded.contract)


def _choose(config: PlayConfig, description: RobotDescription, name: str | None) -> PolicyChoice:
    file, joints = None if config.contract is None else Path(config.contract), description.joint_names
    warning, is_shipped = "", name is None
    if name == PLACEHOLDER:
        checkpoint = placeholder_checkpoint(description)
        warning = "PLACEHOLDER POLICY: no network runs; the action is zero, and the arms hold one pose"
    else:
        path = sample_policy(description.name) if name is None else policy_path(name, also=(PLACEHOLDER, NO_POLICY))
        is_shipped = str(path) != name
        if has_onnxruntime():
            checkpoint = load_checkpoint(path, file, joints)
            if config.hardware is not None:  # a fault, and so DAMPING, while the motors still listen
                checkpoint.limit_inference(0.5 * config.can_timeout)
        else:
            contract = read_contract(path, file, joints)
            checkpoint = Checkpoint(contract, zero_policy(contract.action_count), str(path))
            warning = f"PLACEHOLDER POLICY: {path.name} does NOT run; the action is zero. Run: pip install onnxruntime"
    motion, motion_file, notices = _motion(config, checkpoint, description, is_shipped=is_shipped)
    loaded = checkpoint.with_motion(motion)
    return PolicyChoice(loaded, checkpoint, motion_file, warning, (*_notices(checkpoint, warning), *notices))


def _notices(checkpoint: Checkpoint, warning: str) -> list[str]:
    golden, reading = checkpoint.golden, checkpoint.reading
    if not golden and not warning and not checkpoint.contract.live_inputs:
        golden = "none, so nothing proves that the policy is wired here as it was trained"
    lines = []
    if reading is not None:
        lines = [f"{values}: {source}" for source, values in assumptions(reading.values, reading.source).items()]
        lines += [f"not used: {line}" for line in reading.unused]
    return [*lines, f"golden vectors: {golden}"] if golden else lines


def _motion(
    config: PlayConfig, checkpoint: Checkpoint, description: RobotDescription, *, is_shipped: bool
) -> tuple[Motion | None, Path | None, tuple[str, ...]]:
    """Return the motion that a policy follows, the file that it is from, and what to tell about it."""
    given, task, source = config.motion, checkpoint.contract.task_type, checkpoint.source
    has_own = task == "locomotion" or checkpoint.motion is not None
    if has_own and (given is None or len(config.policy) > 1):  # of several policies it is for those that follow one
        return checkpoint.motion, None, ()
    if task == "locomotion":
        raise InputError(f"--motion: is '{given}', but {source} follows no motion")
    if given is None and not is_shipped:
        raise InputError(f"--motion: is missing; {source} is a {task} policy and follows one")
    if task == "piano" and (given is None or not given.endswith(".mcap")):
        song = load_song(given or SAMPLE_SONG, description, what="--motion")
        why = "left out of the song, beyond reach or more notes at a time than fingers"
        notes = (f"{why}: {song.names_left_out}",) if song.left_out else ()
        motion = song_motion(song, checkpoint.contract.policy_dt, description)
        return motion, song_path(given or SAMPLE_SONG), notes
    file = motion_path(given or SAMPLE_MOTION)
    return read_motion(file), file, ()
