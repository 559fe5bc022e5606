"""`policy stamp`: a copy of a checkpoint that holds its contract and golden vectors, and needs no other file."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np
from rich.markup import escape

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.errors import InputError, blaming
from humanoid_sim.files import output_file, whole_file
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.motion import read_motion
from humanoid_sim.policy.readers.own import GOLDEN_KEY, STAMP_KEY, encode, write_metadata
from humanoid_sim.policy.traces import (
    BodyReader,
    Trace,
    encode_samples,
    read_trace,
    samples_label,
    stored_samples,
    trainer_samples,
)
from humanoid_sim.policy_tools import Stamp
from humanoid_sim.policy_tools.show import make_console
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.simulation.floating_base import base_addresses
from humanoid_sim.simulation.model import SimConfig, build_model, joint_addresses
from humanoid_sim.simulation.sensing import Sensors


def stamp_copy(options: Stamp) -> int:
    """Write the copy, and print what its golden vectors are worth."""
    samples = stamp(
        options.checkpoint,
        options.output,
        contract_file=options.contract,
        description=None if options.robot is None else load_robot(options.robot),
        trace=options.trace,
        motion=options.motion,
        overwrite=options.overwrite,
    )
    label = "none; --trace FILE with the trainer's run proves the wiring" if samples is None else samples_label(samples)
    make_console().print(escape(f"{options.output}: contract inside; golden vectors: {label}"), soft_wrap=True)
    return 0


def stamp(
    checkpoint: str | Path,
    output: str | Path,
    *,
    contract_file: Path | None = None,
    description: RobotDescription | None = None,
    trace: str | Path | None = None,
    motion: str | Path | None = None,
    overwrite: bool = False,
) -> Trace | None:
    """Stamp a copy of a checkpoint, and return its samples: of the trainer's run in `trace`, or those that it has.

    `motion` is what that run followed; `description` is for joints named by place, and what follows from `qpos`.
    """
    path = Path(checkpoint)
    output_file(output, "--output", overwrite=overwrite)
    joints = None if description is None else description.joint_names
    loaded = load_checkpoint(path, contract_file, joints, verify=trace is None)
    contract, samples = loaded.contract, stored_samples(loaded)
    if trace is not None:
        if contract.live_inputs:
            raise InputError(f"--trace: {path} observes live inputs, {', '.join(contract.live_inputs)}: no samples")
        bodies = None if description is None else body_reader(description, contract)
        followed = None if motion is None else read_motion(motion)
        samples = trainer_samples(loaded, read_trace(Path(trace), contract, bodies), followed)
    with blaming(path):
        metadata = {**write_metadata(contract), STAMP_KEY: encode(contract)}
    if samples is not None:
        metadata[GOLDEN_KEY] = encode_samples(samples)
    data = add_metadata(path, metadata)
    with tempfile.TemporaryDirectory() as folder:  # where no other file is near
        copy = Path(folder) / path.name
        copy.write_bytes(data)
        load_checkpoint(copy)
    with whole_file(output) as file:
        file.write(data)
    return samples


def add_metadata(path: Path, metadata: Mapping[str, str]) -> bytes:
    """Return the model with its external tensors inside, and with metadata added to, or in the place of, its own."""
    import onnx  # noqa: PLC0415 - heavy, and only needed here

    with blaming(f"{path}: cannot be read, or written as one ONNX file", Exception):  # protobuf's own types
        model = onnx.load(str(path), load_external_data=True)
        present = {entry.key: entry.value for entry in model.metadata_props}
        onnx.helper.set_model_props(model, {**present, **metadata})
        data: bytes = model.SerializeToString()
    return data


def body_reader(description: RobotDescription, contract: PolicyContract) -> BodyReader:
    """Return a reader of this robot's traces: IMU, anchor body, velocities and ground as the policy observes them."""
    scan = contract.height_scan
    config = SimConfig(anchor_body=contract.anchor_body, velocity_at=contract.velocity_points, height_scan=scan)
    model = build_model(description, scene=False if scan is None else "floor", sensors=config)
    data, sensors = mujoco.MjData(model), Sensors(model, description, config)
    free = 7 if description.is_floating else 0

    def read(qpos: FloatArray, qvel: FloatArray, joint_names: tuple[str, ...]) -> Mapping[str, FloatArray]:
        addresses = joint_addresses(model, joint_names)
        if qpos.shape[1] != free + len(joint_names):
            raise InputError(f"trace: qpos is {qpos.shape[1]} wide, expected {free + len(joint_names)} of this robot")
        rows: list[dict[str, FloatArray]] = []
        for position, velocity in zip(qpos, qvel, strict=True):
            if free:
                place, turn, linear, angular = base_addresses(model, description)
                data.qpos[place], data.qpos[turn] = position[:3], position[3:7]
                data.qvel[linear], data.qvel[angular] = velocity[:3], velocity[3:6]
            data.qpos[addresses.qpos], data.qvel[addresses.dof] = position[free:], velocity[max(free - 1, 0) :]
            mujoco.mj_forward(model, data)
            state = sensors.state(0.0, data.qpos, data.qvel, data.sensordata, np.zeros(description.joint_count))
            imu = {"imu_quaternion": state.imu_quaternion, "imu_angular_velocity": state.imu_angular_velocity}
            rows.append({**imu, **{name: live.value for name, live in state.extern.items()}})
        return {name: np.stack([row[name] for row in rows]) for name in rows[0]}

    return read
