"""A suite and the policies that it tests, with everything that they name read and found to fit: now only to be run."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from humanoid_sim.assets import motion_path
from humanoid_sim.controllers.parameters import joint_indices
from humanoid_sim.envs.config import PolicyEnvConfig, Scenario, build_scenario
from humanoid_sim.errors import InputError, blaming
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.checkpoint import Checkpoint, load_checkpoint
from humanoid_sim.policy.motion import Motion, body_poses, read_motion
from humanoid_sim.policy.song import Song, load_song, song_motion
from humanoid_sim.regress.suite import Case, Suite
from humanoid_sim.robots.description import RobotDescription, load_robot, shipped_robots
from humanoid_sim.simulation.kinematics import InverseKinematics

_TASKS = {"tracking": "tracking", "locomotion": "velocity", "piano": "piano"}  # of suites, by a policy's task_type
_NOT_IN_DIGEST = ("name", "summary", "robot", "cases", "seeds", "tolerances")
_IK_DAMPING = 1e-3  # m/rad: the poses of a motion can be reached, and the joints are to be exact
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
    scenario: Scenario
    steps: int
    target: npt.NDArray[np.floating] | None
    """By frame: shape (F, n), rad, robot's order, where the motion has the joints; of a song (F, 88), 1 for keys that
    should be down; None without."""


@dataclass(frozen=True, slots=True, eq=False)
class TestedPolicy:
    """A checkpoint with all cases of a suite."""

    __test__ = False  # its name is not a test's

    name: str
    prepared: PreparedSuite
    checkpoint: Checkpoint
    cases: tuple[PreparedCase, ...]


def prepare_suite(suite: Suite, folder: Path, robot: str | None = None) -> PreparedSuite:
    """Read what a suite names, with paths relative to a folder; a robot may be given in place of the suite's."""
    name = robot or suite.robot
    if not name:
        raise InputError(f"--robot: is missing; the suite '{suite.name}' is for any robot and names none")
    if not robot and name not in shipped_robots() and (folder / name).is_file():
        name = str(folder / name)
    description = load_robot(name)
    if (suite.task == "velocity" or suite.pushes is not None) and not description.is_floating:
        raise InputError(f"robot '{description.name}': has a fixed base, the suite expects a floating one")
    if suite.task == "piano" and description.piano is None:
        raise InputError(f"robot '{description.name}': has no piano, the suite expects one, such as lite_piano has")
    motions: dict[str, Motion | Song | None] = {}
    for case in suite.cases:
        beside = folder / case.motion
        with blaming(f"case '{case.name}'", InputError):
            if case.song:
                motions[case.name] = load_song(case.song, description, folder, "song")
            else:
                file = beside if beside.is_file() or not case.motion else motion_path(case.motion)
                motions[case.name] = read_motion(file) if case.motion else None
    digests = {case.name: _digest(suite, case, motions[case.name], description) for case in suite.cases}
    return PreparedSuite(suite, description, motions, digests)


def _digest(suite: Suite, case: Case, motion: Motion | Song | None, description: RobotDescription) -> str:
    """SHA-256 of the suite's conditions, the case, its motion or song, and the robot with its MJCF.

    Neither names for people nor what only the judging depends on takes part, nor the motion that is in a policy.
    """
    conditions: dict[str, Any] = msgspec.to_builtins(suite)
    for name in _NOT_IN_DIGEST:
        del conditions[name]
    described = {**msgspec.to_builtins(case), "motion": bool(case.motion), "song": bool(case.song)}
    document = {"conditions": conditions, "case": described, "robot": description.to_json()}
    digest = hashlib.sha256(msgspec.json.encode(document, order="deterministic"))
    if isinstance(motion, Song):
        notes = np.array([(note.key, note.start, note.end) for note in motion.notes])
        digest.update(np.round(notes, 6).tobytes())  # to 1 µs: a reader of MIDI may sum times in another order
    elif motion is not None:
        digest.update(motion.frames.tobytes())
    for text in _mjcf(description.mjcf_path):
        digest.update(text)
    return digest.hexdigest()


def _mjcf(path: Path) -> Iterator[bytes]:
    if path.is_file():
        text = path.read_bytes()
        yield text
        for name in _INCLUDE.findall(text):
            yield from _mjcf(path.parent / name.decode())


def prepare_policy(
    prepared: PreparedSuite, path: Path, contract_file: Path | None = None, name: str = ""
) -> TestedPolicy:
    """Load a checkpoint and bring it together with every case of a suite; its name is by default the file's."""
    suite = prepared.suite
    checkpoint = load_checkpoint(path, contract_file, prepared.description.joint_names)
    task_type = checkpoint.contract.task_type
    if _TASKS[task_type] != suite.task:
        raise InputError(
            f"{path}: is a policy for task_type {task_type}, the suite '{suite.name}' is for {suite.task}; see --suite"
        )
    with blaming(f"policy '{path.stem}'", InputError):
        cases = tuple(_prepare_case(prepared, case, checkpoint) for case in suite.cases)
    return TestedPolicy(name or path.stem, prepared, checkpoint, cases)


def _prepare_case(prepared: PreparedSuite, case: Case, checkpoint: Checkpoint) -> PreparedCase:
    suite, motion = prepared.suite, prepared.motions[case.name]
    if isinstance(motion, Song):
        motion = song_motion(motion, checkpoint.contract.policy_dt, prepared.description)
    elif suite.task == "tracking" and motion is None:
        motion = checkpoint.motion
    config = PolicyEnvConfig(
        policy=checkpoint,
        robot=prepared.description,
        motion=motion,
        task="velocity" if suite.task == "velocity" else "auto",
        implicit=suite.implicit,
        joint_noise=suite.start.joint_position,
        velocity_noise=suite.start.joint_velocity,
    )
    followed = case.motion or case.song or "the motion in the policy"
    scenario = build_scenario(config, motion_source=f"case '{case.name}': {followed}")
    steps = scenario.wiring.reference.frame_count - 1
    if case.duration is not None:
        steps = round(case.duration / scenario.contract.policy_dt)
    steps, target = max(steps, 1), None
    if motion is not None:
        target = motion.frames if suite.task == "piano" else _reference_joints(scenario, steps + 1)
    return PreparedCase(suite, case, scenario, steps, target)


def _reference_joints(scenario: Scenario, count: int) -> FloatArray | None:
    """Return the joints of a motion's first `count` frames, shape (count, n), rad, in the robot's order.

    Those of a motion that has bodies only bring them there. None where it says nothing of joints or bodies.
    """
    terms, contract, description = scenario.wiring.reference.terms, scenario.contract, scenario.description
    if "reference_joint_pos" in terms:
        order = joint_indices(description.joint_names, contract.joint_names, "joints of the robot")
        return terms["reference_joint_pos"][:count, order].astype(np.float64)
    if "motion_body_pos_b" not in terms:
        return None
    frames = np.concatenate([terms["motion_body_pos_b"], terms["motion_body_ori_b"]], axis=1)[:count]
    position, rotation = body_poses(frames, len(contract.body_names))
    solver = InverseKinematics(description, contract.body_names, damping=_IK_DAMPING)
    return solver.solve_path(position, rotation, np.array(description.initial_position))
