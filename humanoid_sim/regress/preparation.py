"""A suite and the policies that it tests, with everything that they name read and found to fit: now only to be run."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import msgspec

from humanoid_sim.assets import motion_path, shipped
from humanoid_sim.envs.config import PolicyEnvConfig, Scenario, build_scenario
from humanoid_sim.errors import InputError, blaming
from humanoid_sim.policy.checkpoint import Checkpoint, load_checkpoint
from humanoid_sim.policy.motion import Motion, read_motion
from humanoid_sim.policy.song import Song, load_song, song_motion
from humanoid_sim.regress.suite import Case, Suite
from humanoid_sim.robots.description import RobotDescription, load_robot

_TASKS = {"tracking": "tracking", "locomotion": "velocity", "piano": "piano"}  # of suites, by a policy's task_type
_INCLUDE = re.compile(rb"<include\s[^>]*file\s*=\s*[\"']([^\"']+)[\"']")


@dataclass(frozen=True, slots=True, eq=False)
class PreparedSuite:
    """A suite with its motions read, on a robot."""

    suite: Suite
    description: RobotDescription
    motions: Mapping[str, Motion | Song | None]
    """Motion by case, or what the robot can play of its song; None where the case names none."""
    digests: Mapping[str, str]
    """SHA-256 by case of all that its episodes depend on beside policy and seed: only equals are compared."""


@dataclass(frozen=True, slots=True, eq=False)
class PreparedCase:
    """One policy and one case, found to fit."""

    suite: Suite
    case: Case
    checkpoint: Checkpoint
    scenario: Scenario
    steps: int


def prepare_suite(suite: Suite, folder: Path, robot: str | None = None) -> PreparedSuite:
    """Read what a suite names, with paths relative to a folder; a robot may be given in place of the suite's."""
    name = robot or suite.robot
    if not name:
        raise InputError(f"--robot: is missing; the suite '{suite.name}' is for any robot and names none")
    if not robot and name not in shipped("robots") and (folder / name).is_file():
        name = str(folder / name)
    description = load_robot(name)
    if suite.task == "velocity" and not description.is_floating:
        raise InputError(f"robot '{description.name}': has a fixed base, the suite expects a floating one")
    motions: dict[str, Motion | Song | None] = {case.name: None for case in suite.cases}
    for case in suite.cases:
        with blaming(f"case '{case.name}'", InputError):
            if case.song:
                motions[case.name] = load_song(case.song, description, folder, "song")
            elif case.motion:
                beside = folder / case.motion
                motions[case.name] = read_motion(beside if beside.is_file() else motion_path(case.motion))
    digests = {case.name: _digest(suite, case, motions[case.name], description) for case in suite.cases}
    return PreparedSuite(suite, description, motions, digests)


def _digest(suite: Suite, case: Case, motion: Motion | Song | None, description: RobotDescription) -> str:
    """SHA-256 of the suite's conditions, the case, its motion or song, and the robot with its MJCF.

    Neither names for people nor what only the judging depends on takes part, nor the motion that is in a policy.
    """
    conditions = suite.task, suite.start, suite.randomisation, suite.settle, suite.implicit
    limits = (description.lower, description.upper, description.effort_limit, description.torque_scale)
    robot = (
        *(description.joint_names, description.initial_position, *(limit.tolist() for limit in limits)),
        *(description.delay.tolist(), description.simulation, description.base, description.piano),
    )
    documents = conditions, case.name, case.command, case.duration, robot
    digest = hashlib.sha256(msgspec.json.encode(documents, order="deterministic"))
    if isinstance(motion, Song):  # to 1 µs: a reader of MIDI may sum times in another order
        notes = [(note.key, round(note.start, 6), round(note.end, 6)) for note in motion.notes]
        digest.update(msgspec.json.encode(notes))
    elif motion is not None:
        digest.update(motion.frames.tobytes())
    for text in _mjcf(description.mjcf_path):
        digest.update(text)
    return digest.hexdigest()


def _mjcf(path: Path) -> Iterator[bytes]:
    """Yield an MJCF and the files that it includes."""
    text = path.read_bytes()
    yield text
    for name in _INCLUDE.findall(text):
        yield from _mjcf(path.parent / name.decode())


def prepare_policy(prepared: PreparedSuite, path: Path, contract_file: Path | None = None) -> list[PreparedCase]:
    """Load a checkpoint and bring it together with every case of a suite."""
    suite = prepared.suite
    checkpoint = load_checkpoint(path, contract_file, prepared.description.joint_names)
    task_type = checkpoint.contract.task_type
    if _TASKS[task_type] != suite.task:
        raise InputError(
            f"{path}: is a policy for task_type {task_type}, the suite '{suite.name}' is for {suite.task}; see --suite"
        )
    cases = []
    for case in suite.cases:
        motion = prepared.motions[case.name]
        with blaming(f"policy '{path.stem}': case '{case.name}'", InputError):
            if isinstance(motion, Song):
                motion = song_motion(motion, checkpoint.contract.policy_dt, prepared.description)
            config = PolicyEnvConfig(
                policy=checkpoint,
                robot=prepared.description,
                motion=motion,
                task="velocity" if suite.task == "velocity" else "auto",
                implicit=suite.implicit,
                joint_noise=suite.start.joint_position,
                velocity_noise=suite.start.joint_velocity,
            )
            scenario = build_scenario(config)
        steps = scenario.wiring.reference.frame_count - 1
        if case.duration is not None:
            steps = round(case.duration / scenario.contract.policy_dt)
        cases.append(PreparedCase(suite, case, checkpoint, scenario, max(steps, 1)))
    return cases
