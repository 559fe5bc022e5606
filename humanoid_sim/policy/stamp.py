"""Write a checkpoint's whole contract and golden vectors into a copy of it, which then needs no other file."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.files import whole_file
from humanoid_sim.policy.checkpoint import Checkpoint
from humanoid_sim.policy.contract_json import STAMP_KEY, encode
from humanoid_sim.policy.golden.blind import blind_spots
from humanoid_sim.policy.golden.make import own_samples, trainer_samples
from humanoid_sim.policy.golden.samples import GOLDEN_KEY, GoldenSamples, decode_samples, encode_samples
from humanoid_sim.policy.golden.trace import read_trace
from humanoid_sim.policy.golden.verify import verify_golden
from humanoid_sim.policy.metadata import write_metadata
from humanoid_sim.policy.motion import read_motion
from humanoid_sim.policy.onnx_model import first_line
from humanoid_sim.policy.onnx_policy import OnnxPolicy, load_checkpoint
from humanoid_sim.robots.description import RobotDescription

__all__ = ["StampResult", "add_metadata", "stamp"]

_PROBES = 8
"""Observations, beside the golden ones, on which the copy must answer bit for bit what the original does."""


@dataclass(frozen=True, slots=True)
class StampResult:
    """What was written."""

    output: Path
    size: int
    """bytes"""
    samples: GoldenSamples
    blind_spots: tuple[str, ...]
    """Mistakes that the samples could not show; empty for samples that are drift only anyway."""


def stamp(
    path: Path,
    output: Path,
    *,
    contract_file: Path | None = None,
    description: RobotDescription | None = None,
    trace: Path | None = None,
    motion: Path | None = None,
    overwrite: bool = False,
) -> StampResult:
    """Stamp a copy of a checkpoint.

    The copy holds external tensors itself, the thirteen metadata keys, the complete contract, and golden vectors: of
    the trace; or else those of a trainer's run that the checkpoint has already; or else ones of this program, which
    are drift only. Whatever other metadata the checkpoint has stays. The copy is loaded, and its contract and actions
    compared with the original's, before a file takes the name `output`.

    Args:
        path: the checkpoint.
        output: the copy.
        contract_file: a contract.yaml; None: the one beside the checkpoint, if there is one.
        description: the robot, for contracts that name joints by place, and for traces whose anchor poses follow from
            `qpos`.
        trace: a trainer's run, see `humanoid_sim.policy.golden.trace`.
        motion: what the policy follows, where the model does not carry it.
        overwrite: replace `output` if it exists.

    Raises:
        InputError: the checkpoint, its contract or the trace is refused, or the copy cannot be written.
    """
    _check_output(path, output, overwrite)
    joints = None if description is None else description.joint_names
    checkpoint = load_checkpoint(path, contract_file, joints, verify=False)
    samples = _samples(checkpoint, _metadata(checkpoint), description, trace, motion)
    try:
        metadata = {
            **write_metadata(checkpoint.contract),
            STAMP_KEY: encode(checkpoint.contract),
            GOLDEN_KEY: encode_samples(samples),
        }
    except FieldError as error:
        raise InputError(f"{path}: {str(error).removeprefix('PolicyContract.')}") from None
    data = add_metadata(path, metadata)
    _check_copy(checkpoint, data, samples)
    with whole_file(output) as file:
        file.write(data)
    unseen = blind_spots(checkpoint, samples) if samples.origin == "trainer" else ()
    return StampResult(output, len(data), samples, unseen)


def add_metadata(path: Path, metadata: Mapping[str, str]) -> bytes:
    """The model with its external tensors inside, and with metadata added to, or in the place of, its own.

    Raises:
        InputError: the file is no ONNX model, its external tensors are missing, or it is larger than one file can be.
    """
    import onnx  # noqa: PLC0415 - heavy, and only needed here

    try:
        model = onnx.load(str(path), load_external_data=True)
    except Exception as error:  # protobuf's exception types are not part of onnx's interface
        raise InputError(f"{path}: cannot be read as an ONNX model: {first_line(error)}") from None
    onnx.helper.set_model_props(model, {entry.key: entry.value for entry in model.metadata_props} | dict(metadata))
    try:
        data: bytes = model.SerializeToString()
    except Exception as error:  # likewise: more than the 2 GiB that protobuf can hold
        raise InputError(f"{path}: cannot be written as one file: {first_line(error)}") from None
    return data


def _check_output(path: Path, output: Path, overwrite: bool) -> None:
    if output.is_dir():
        raise InputError(f"{output}: is a directory, expected the name of a file to write")
    if not output.parent.is_dir():
        raise InputError(f"{output}: its folder does not exist")
    if output.exists() and path.exists() and output.samefile(path):
        raise InputError(f"{output}: is the checkpoint itself, expected another file: the original stays as it is")
    if output.exists() and not overwrite:
        raise InputError(f"{output}: exists already; --overwrite replaces it")


def _metadata(checkpoint: Checkpoint) -> Mapping[str, str]:
    policy = checkpoint.policy
    return policy.metadata if isinstance(policy, OnnxPolicy) else MappingProxyType({})


def _samples(
    checkpoint: Checkpoint,
    metadata: Mapping[str, str],
    description: RobotDescription | None,
    trace: Path | None,
    motion_file: Path | None,
) -> GoldenSamples:
    motion = None if motion_file is None else read_motion(motion_file)
    if trace is not None:
        bodies = None
        if description is not None:
            from humanoid_sim.policy.golden.bodies import body_reader  # noqa: PLC0415 - MuJoCo only with a robot

            bodies = body_reader(description, checkpoint.contract.anchor_body)
        return trainer_samples(checkpoint, read_trace(trace, checkpoint.contract, bodies), motion)
    if GOLDEN_KEY in metadata:
        samples = decode_samples(metadata[GOLDEN_KEY], checkpoint.source)
        if samples.origin == "trainer":
            verify_golden(checkpoint, metadata)
            return samples
    return own_samples(checkpoint, motion)


def _check_copy(original: Checkpoint, data: bytes, samples: GoldenSamples) -> None:
    """Load the copy where no other file is near, and compare."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "copy.onnx"
        path.write_bytes(data)
        try:
            copy = load_checkpoint(path)
        except InputError as error:
            problem = str(error).removeprefix(f"{path}: ")
            raise InputError(f"{original.source}: a stamped copy would not load: {problem}") from None
    different = _different_field(original.contract, copy.contract)
    if different:
        raise InputError(f"{original.source}: {different} would read back differently from a stamped copy")
    probes = np.random.default_rng(0).normal(0.0, 1.0, (_PROBES, samples.observation.shape[1])).astype(np.float32)
    for frame, observation in enumerate([*samples.observation, *probes]):
        if not np.array_equal(original.policy(observation, frame), copy.policy(observation, frame)):
            raise InputError(f"{original.source}: a stamped copy would answer other actions; nothing was written")


def _different_field(a: PolicyContract, b: PolicyContract) -> str:
    """Name of the first field that is not bit for bit the same; provenance may differ."""
    first, second = (json.loads(encode(replace(contract, provenance={}))) for contract in (a, b))
    return next((name for name in first if json.dumps(first[name]) != json.dumps(second.get(name))), "")
