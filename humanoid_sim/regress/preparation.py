"""A suite and the policies that it tests, with everything that they name read and found to fit: now only to be run."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from humanoid_sim.assets import motion_path
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.parameters import joint_indices
from humanoid_sim.controllers.reference import MotionReference
from humanoid_sim.envs.scenario import Scenario, make_scenario
from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.checkpoint import Checkpoint, load_checkpoint
from humanoid_sim.policy.motion import Motion, body_poses, read_motion
from humanoid_sim.policy.onnx_policy import OnnxPolicy
from humanoid_sim.policy.song import Song, named_song, song_motion
from humanoid_sim.regress.batched_policy import BatchedPolicy
from humanoid_sim.regress.suite import Case, Suite
from humanoid_sim.robots.description import RobotDescription, load_robot, shipped_robots
from humanoid_sim.simulation.kinematics import InverseKinematics

_JUDGING = ("seeds", "first_seed", "tolerances", "confidence", "resamples")
_POLICIES = {
    "tracking": ("tracking", "a policy that follows motions", "--suite lite_tracking"),
    "locomotion": ("velocity", "one that walks at a velocity", "--suite velocity --robot lite_biped"),
    "piano": ("piano", "one that plays songs", "--suite lite_piano"),
}
"""By `task_type` of a policy: the task of its suites, itself in words, and the options of a suite for it."""
_IK_DAMPING = 1e-3  # m/rad: the poses of a motion can be reached, and the joints are to be exact
_NAMES = ("name", "summary", "robot", "cases")
_INCLUDE = re.compile(rb"<include\s[^>]*file\s*=\s*[\"']([^\"']+)[\"']")


@dataclass(frozen=True, slots=True, eq=False)
class PreparedSuite:
    """A suite with its motions read, on a robot."""

    suite: Suite
    description: RobotDescription
    """Robot as it is without a policy."""
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
    policy: BatchedPolicy
    description: RobotDescription
    """Robot as it is without a policy."""
    motion: Motion | None
    scenario: Scenario
    steps: int
    """Policy steps of a whole episode."""
    joint_reference: FloatArray | None
    """Shape (F, n), rad, robot's order: where the motion has the joints, frame by frame as far as an episode comes;
    None without a motion."""


@dataclass(frozen=True, slots=True, eq=False)
class TestedPolicy:
    """A checkpoint with all cases of a suite."""

    __test__ = False  # its name is not a test's

    name: str
    prepared: PreparedSuite
    checkpoint: Checkpoint
    policy: BatchedPolicy
    cases: tuple[PreparedCase, ...]


def prepare_suite(suite: Suite, folder: Path, robot: str | None = None) -> PreparedSuite:
    """Read what a suite names, with paths relative to a folder; a robot may be given in place of the suite's.

    Raises `InputError` if no robot is named, the robot is not one for the suite, or a motion cannot be read.
    """
    name = robot or suite.robot
    if not name:
        raise InputError(f"--robot: is missing; the suite '{suite.name}' is for any robot and names none")
    path = Path(name) if robot else folder / name
    name = name if name in shipped_robots() or not path.is_file() else str(path.resolve())
    description = load_robot(name)
    if not description.is_floating:  # what it cannot do, or would not feel and would be praised for withstanding
        where = f"robot '{description.name}': has a fixed base"
        if suite.task == "velocity":
            raise InputError(f"{where}, a velocity suite expects a floating one")
        if suite.pushes is not None:
            raise InputError(f"{where}, which the suite's pushes would not move")
    if suite.task == "piano" and description.piano is None:
        raise InputError(f"robot '{description.name}': has no piano, a piano suite expects one, such as lite_piano has")
    if suite.base_height is not None:
        base = msgspec.structs.replace(description.base, height=suite.base_height)
        description = msgspec.structs.replace(description, base=base)
    motions: dict[str, Motion | Song | None] = {}
    for case in suite.cases:
        beside = folder / case.motion
        try:
            if case.song:
                motions[case.name], _ = named_song(case.song, description, folder, "song")
                continue
            file = beside if beside.is_file() or not case.motion else motion_path(case.motion)
            motions[case.name] = read_motion(file) if case.motion else None
        except InputError as error:
            raise InputError(f"case '{case.name}': {str(error).removeprefix('--motion: ')}") from None
    digests = {case.name: _digest(suite, case, motions[case.name], description) for case in suite.cases}
    return PreparedSuite(suite, description, motions, digests)


def _digest(suite: Suite, case: Case, motion: Motion | Song | None, description: RobotDescription) -> str:
    """SHA-256 of the suite's conditions, the case, its motion or song, and the robot with its MJCF.

    Neither names for people nor what only the judging depends on takes part, nor the motion that is in a policy.
    """
    conditions: dict[str, Any] = msgspec.to_builtins(suite)
    for name in (*_JUDGING, *_NAMES):
        del conditions[name]
    if suite.actuation == "affine":  # what baselines ran that know of no other
        del conditions["actuation"]
    described = {**msgspec.to_builtins(case), "motion": bool(case.motion), "song": bool(case.song)}
    if not case.song:  # what baselines ran that know of none
        del described["song"]
    document = {"conditions": conditions, "case": described, "robot": description.to_json()}
    digest = hashlib.sha256(msgspec.json.encode(document, order="deterministic"))
    if isinstance(motion, Song):
        digest.update(np.array([(note.key, note.start, note.end) for note in motion.notes]).tobytes())
    elif motion is not None:
        digest.update(motion.frames.tobytes())
    for text in _mjcf(description.mjcf_path):
        digest.update(text)
    return digest.hexdigest()


def _mjcf(path: Path, depth: int = 8) -> Iterator[bytes]:
    """Yield the text of an MJCF and of what it includes; meshes do not take part."""
    if depth and path.is_file():
        text = path.read_bytes()
        yield text
        for name in _INCLUDE.findall(text):
            yield from _mjcf(path.parent / name.decode(errors="replace"), depth - 1)


def prepare_policy(
    prepared: PreparedSuite, path: Path, contract_file: Path | None = None, name: str = ""
) -> TestedPolicy:
    """Load a checkpoint and bring it together with every case of a suite; its name is by default the file's.

    Raises `InputError`: one line that names the file and what is wrong, or does not fit.
    """
    suite, description = prepared.suite, prepared.description
    checkpoint = load_checkpoint(path, contract_file, description.joint_names)
    contract = checkpoint.contract
    task, _, use = _POLICIES[contract.task_type]
    if task != suite.task:
        (wanted,) = (described for task, described, _ in _POLICIES.values() if task == suite.task)
        raise InputError(
            f"{path}: is a policy for task_type {contract.task_type}, the suite '{suite.name}' is for {wanted}; use "
            f"{use}"
        )
    assert isinstance(checkpoint.policy, OnnxPolicy)  # load_checkpoint makes no other
    policy = BatchedPolicy(checkpoint.policy)
    cases = []
    for case in suite.cases:
        motion = prepared.motions[case.name]
        if isinstance(motion, Song):
            motion = song_motion(motion, contract.policy_dt, description)
        cases.append(prepare_case(suite, case, checkpoint, policy, description, motion))
    return TestedPolicy(name or path.stem, prepared, checkpoint, policy, tuple(cases))


def prepare_case(
    suite: Suite,
    case: Case,
    checkpoint: Checkpoint,
    policy: BatchedPolicy,
    description: RobotDescription,
    motion: Motion | None,
) -> PreparedCase:
    """Bring a policy and a case together. Raises `InputError`: one line that names the checkpoint and what is wrong.

    The motion is the one that the case names, or its song's goals; None for the policy's own, or for a task without.
    """
    if suite.task == "tracking" and motion is None:
        motion = checkpoint.motion
        if motion is None:
            raise InputError(f"{checkpoint.source}: carries no motion, and case '{case.name}' of the suite names none")
    try:
        scenario = make_scenario(
            checkpoint,
            description,
            motion,
            task="velocity" if suite.task == "velocity" else "auto",
            physics_timestep=suite.physics_timestep,
            actuation=suite.actuation,
            action_limit=suite.action_limit,
            motion_source=f"case '{case.name}': {case.motion or case.song or 'the motion in the policy'}",
            joint_noise=suite.start.joint_position,
            velocity_noise=suite.start.joint_velocity,
        )
    except InputError as error:
        text = str(error)
        raise InputError(text if checkpoint.source in text else f"{checkpoint.source}: {text}") from None
    wanted = scenario.wiring.reference.frame_count - 1
    if case.duration is not None:
        wanted = round(case.duration / scenario.contract.policy_dt)
    steps = max(wanted, 1)
    reference = scenario.wiring.reference
    joints = None
    if motion is not None:
        joints = _reference_joints(scenario.description, scenario.contract, reference, steps + 1)
    return PreparedCase(suite, case, checkpoint, policy, description, motion, scenario, steps, joints)


def _reference_joints(
    description: RobotDescription, contract: PolicyContract, reference: MotionReference, count: int
) -> FloatArray | None:
    """Return the joints of a motion's first `count` frames, shape (count, n), rad, in the robot's order.

    Those of a motion that has bodies only bring them there. None where it says nothing of joints or bodies.
    """
    terms = reference.terms
    if "reference_joint_pos" in terms:
        order = joint_indices(description.joint_names, contract.joint_names, "joints of the robot")
        return terms["reference_joint_pos"][:count, order].astype(np.float64)
    if "motion_body_pos_b" not in terms:
        return None
    frames = np.concatenate([terms["motion_body_pos_b"], terms["motion_body_ori_b"]], axis=1)[:count]
    position, rotation = body_poses(frames, len(contract.body_names))
    solver = InverseKinematics(description, contract.body_names, damping=_IK_DAMPING)
    return solver.solve_path(position, rotation, np.array(description.initial_position))


def distinct_names(sources: Sequence[Path]) -> list[str]:
    """Names of files that tell them apart: their own, or, where two share it, what differs in their paths.

    `runs/a/policy.onnx` and `runs/b/policy.onnx` are `a` and `b`. A file that is given twice has one name.
    """
    paths = [source.resolve().with_suffix("").parts for source in sources]
    distinct = set(paths)
    shortest = min(map(len, distinct))
    first = last = 0
    while first < shortest - 1 and len({parts[first] for parts in distinct}) == 1:
        first += 1
    while last < shortest - first and len({parts[-1 - last] for parts in distinct}) == 1:
        last += 1
    for begin, end in ((-1, 0), (first, last), (first, 0)):
        names = ["/".join(parts[begin : len(parts) - end]) or parts[-1] for parts in paths]
        if len(set(names)) == len(distinct):
            break
    return names
