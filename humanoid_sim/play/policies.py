"""The policy that `play` runs, and its motion: those that options name, or those of a recording to play again."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from humanoid_sim.assets import SAMPLE_MOTION, SAMPLE_SONG, motion_path, sample_policy, song_path
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.policy_step import Policy
from humanoid_sim.errors import InputError
from humanoid_sim.messages import SessionHeader
from humanoid_sim.play.early import checkpoint_path
from humanoid_sim.play.options import NO_POLICY, SIMULATED, PlayConfig
from humanoid_sim.policy.checkpoint import (
    PLACEHOLDER,
    Checkpoint,
    load_checkpoint,
    placeholder_checkpoint,
    read_contract,
    zero_policy,
)
from humanoid_sim.policy.loaded_policy import LoadedPolicy, load_policy
from humanoid_sim.policy.motion import MOTION_ATTACHMENT, Motion, read_motion
from humanoid_sim.policy.onnx_policy import has_onnxruntime
from humanoid_sim.policy.random_songs import choose_song, is_generated
from humanoid_sim.policy.song import key_name, left_out, song_motion
from humanoid_sim.recording.reader import open_recording, recorded_settings
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.push import parse_pushes


@dataclass(frozen=True, slots=True)
class PolicyChoice:
    """The policy of a run, and what the user must be told about it."""

    loaded: LoadedPolicy | None = None
    """Policy with its motion; None in a run without."""
    checkpoint: Checkpoint | None = None
    motion: Motion | None = None
    motion_file: Path | None = None
    warning: str = ""
    notices: tuple[str, ...] = ()
    """Notices about its motion."""

    @property
    def contract(self) -> PolicyContract | None:
        """Contract of the policy; None without one."""
        return None if self.loaded is None else self.loaded.contract

    @property
    def source(self) -> str:
        """Name for operators: its file, or `none`."""
        return NO_POLICY if self.checkpoint is None else self.checkpoint.source

    @property
    def settings(self) -> dict[str, str | None]:
        """Fields of a recording's settings."""
        return {
            "policy": None if self.checkpoint is None else self.checkpoint.source,
            "policy_sha256": None if self.checkpoint is None else self.checkpoint.sha256,
            "motion": None if self.motion_file is None else str(self.motion_file),
        }

    @property
    def motion_frames(self) -> int:
        """Length of the motion in policy steps; 0 for none."""
        return 0 if self.motion is None else len(self.motion.frames)

    @property
    def walks(self) -> bool:
        """Return whether it takes a velocity command."""
        return self.loaded is not None and self.loaded.contract.takes_velocity_command


def choose_policy(
    config: PlayConfig, description: RobotDescription, wrap: Callable[[Policy], Policy] = lambda policy: policy
) -> PolicyChoice:
    """Load the checkpoint and the motion that the options name.

    Args:
        description: of the robot; the placeholder is made for it.
        wrap: put around the policy's callable, for faults that are injected deliberately.
    """
    if not config.has_policy:
        return PolicyChoice()
    path = checkpoint_path(config) or sample_policy(description.name)
    contract_file = None if config.contract is None else Path(config.contract)
    warning = ""
    if config.checkpoint == PLACEHOLDER:
        checkpoint = placeholder_checkpoint(description, config.pose)
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
    motion, file, notices = _chosen_motion(config, checkpoint, description)
    loaded = load_policy(
        checkpoint.contract,
        wrap(checkpoint.policy),
        motion,
        checkpoint.observation_width,
        source=checkpoint.source,
        motion_source=str(file),
    )
    return PolicyChoice(loaded, checkpoint, motion, file, warning, notices)


def _is_sample(config: PlayConfig) -> bool:
    """Return whether the policy is one that ships: taken by default, or given by its name."""
    path = checkpoint_path(config)
    return config.checkpoint is None or (path is not None and str(path) != config.checkpoint)


def _chosen_motion(
    config: PlayConfig, checkpoint: Checkpoint, description: RobotDescription
) -> tuple[Motion | None, Path | None, tuple[str, ...]]:
    """Return the motion, the file that it is from, and what to tell about it."""
    if not _plays_song(config, checkpoint):
        file = _motion_file(config, checkpoint)
        return (checkpoint.motion if file is None else read_motion(file, config.motion_topic)), file, ()
    name = config.song or SAMPLE_SONG
    song, dropped = choose_song(name, description)
    if not song.notes:
        assert description.piano is not None  # nothing else leaves notes out
        low, high = (key_name(bound) for bound in (min(description.piano.keys), max(description.piano.keys)))
        raise InputError(
            f"--song: none of the notes of {name} is between {low} and {high}, where '{description.name}' reaches; "
            "prepare --song --transpose moves it"
        )
    motion = song_motion(song, checkpoint.contract.policy_dt, description)
    why = "left out of the song, beyond reach or more notes at a time than fingers"
    file = Path(name) if is_generated(name) else song_path(name)
    return motion, file, (f"{why}: {left_out(dropped)}",) if dropped else ()


def _plays_song(config: PlayConfig, checkpoint: Checkpoint) -> bool:
    """Return whether the motion is a song that is yet to be prepared."""
    task = checkpoint.contract.task_type
    if task != "piano":
        if config.song is not None:
            raise InputError(f"--song: is '{config.song}', but {checkpoint.source} is a {task} policy")
        return False
    if config.song is None and config.motion is None and not _is_sample(config):
        raise InputError(f"--song: is missing; {checkpoint.source} is a piano policy")
    return config.motion is None


def _motion_file(config: PlayConfig, checkpoint: Checkpoint) -> Path | None:
    task = checkpoint.contract.task_type
    if task == "locomotion":
        if config.motion is not None:
            raise InputError(f"--motion: is '{config.motion}', but {checkpoint.source} follows no motion")
        return None
    if config.motion is not None:
        return motion_path(config.motion)
    if checkpoint.motion is not None:
        return None
    if _is_sample(config):
        return motion_path(SAMPLE_MOTION)
    dataset = checkpoint.contract.dataset_repo_id
    hint = f"; its default is the dataset '{dataset}', to be converted to an .mcap motion first" if dataset else ""
    raise InputError(f"--motion: is missing; {checkpoint.source} is a {task} policy and follows a motion{hint}")


def parse_branch(text: str) -> tuple[str, float]:
    """Return the file, and s on the robot's clock, of FILE@SECONDS."""
    path, _, seconds = text.rpartition("@")
    try:
        time = float(seconds)
    except ValueError:
        time = math.nan
    if not path or not math.isfinite(time):
        raise InputError(f"--branch: is '{text}', expected FILE@SECONDS, such as run.mcap@12.5")
    return path, time


_REPEATED = ("policy", "contract", "robot", "command", "action_limit", "control_frequency", *SIMULATED)
"""Options that are taken from the recording."""


def with_recorded_options(config: PlayConfig) -> PlayConfig:
    """Return the options of `config`, and the recording's where they were left as they are by default.

    What the run looked like, where it was written to and who drove it are not taken from there.

    Raises:
        InputError: the recording cannot be read, or does not say what it was made with.
    """
    if config.again is None and config.branch is None:
        return config
    option, path = (
        ("--again", config.again) if config.again is not None else ("--branch", parse_branch(config.branch or "")[0])
    )
    recording = open_recording(path)
    begin = math.inf
    if config.branch is not None:
        begin = parse_branch(config.branch)[1] - 0.5 * recording.header.control_period
    header = recording.of_last_policy(begin).header
    recorded = _options(option, path, header)
    had_none = "contract" not in header.documents and recorded.get("policy") in (None, NO_POLICY)
    if had_none and recorded.get("shadow") is None:
        if config.branch is not None and config.policy is None:
            raise InputError(f"--branch: '{path}' has no policy at that time; name one with --policy")
        recorded["policy"] = NO_POLICY
    elif recorded.get("policy") is None and config.hardware is not None:
        recorded["policy"] = recorded_settings(path, header).get("policy")
    if recorded.get("shadow") is not None:
        if config.branch is not None or config.checkpoint is None:
            other = "" if config.branch is not None else "; name one with --policy or --shadow"
            raise InputError(f"{option}: '{path}' was made with --shadow, and no policy drove its robot{other}")
        recorded.pop("contract", None)  # it is for the shadow
    if config.policy is not None:
        recorded.pop("contract", None)  # it is for the recorded policy
    if config.branch is not None:
        recorded.pop("command", None)  # the velocity goes on as recorded
        config = replace(config, push=(*_recorded_pushes(path, recorded), *_later_pushes(config)))
    values = {name: recorded[name] for name in _REPEATED if name in recorded and not config.is_given(name)}
    if config.motion is None and config.song is None and MOTION_ATTACHMENT in header.attachments:
        last = recording.of_last_policy().header.attachments.get(MOTION_ATTACHMENT)
        if last != header.attachments[MOTION_ATTACHMENT]:
            raise InputError(f"{option}: '{path}' followed another motion later; name the motion with --motion")
        values["motion"] = path  # a recording is read as the motion that it was made with, the last one
    return replace(config, **values)


def _recorded_pushes(path: str, recorded: dict[str, Any]) -> tuple[str, ...]:
    """Those of the recorded run: what it went through comes again."""
    texts = recorded.get("push", [])
    if not (isinstance(texts, list) and all(isinstance(text, str) for text in texts)):
        raise InputError(f"--branch: '{path}' was made with push {texts!r}, which is no such option")
    return tuple(texts)


def _later_pushes(config: PlayConfig) -> tuple[str, ...]:
    """Those that the options add."""
    begin = parse_branch(config.branch or "")[1]
    for text, push in zip(config.push, parse_pushes(config.push), strict=True):
        if push.time < begin:
            raise InputError(f"--push: is '{text}', expected at {begin:g} s, where the branch begins, or later")
    return config.push


def _options(option: str, path: str, header: SessionHeader) -> dict[str, Any]:
    """Return the options that a recording was made with, those that `play` knows and of a kind that it takes."""
    try:
        options = recorded_settings(path, header).get("options")
    except InputError:
        options = None
    if not isinstance(options, dict):
        raise InputError(
            f"{option}: '{path}' does not say what it was made with, expected a recording of play or regress"
        )
    for field in fields(PlayConfig):
        value = options.get(field.name, field.default)
        kinds = {type(field.default), str, float} if field.default is None else {type(field.default), int}
        if value is not None and type(value) not in kinds and field.name in _REPEATED:
            raise InputError(f"{option}: '{path}' was made with {field.name} {value!r}, which is no such option")
    return options
