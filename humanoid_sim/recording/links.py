"""Poses of a recorded robot's links, by MuJoCo's kinematics of the URDF in the header."""

from __future__ import annotations

from typing import Self

import mujoco
import numpy as np

from humanoid_sim.controllers.rotation import conjugate, multiply
from humanoid_sim.errors import blaming
from humanoid_sim.messages import URDF_DOCUMENT, SessionHeader, TickRecord
from humanoid_sim.mit import FloatArray
from humanoid_sim.recording.header import json_document

_FREE, _BALL = mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL


def urdf_model(urdf: str) -> mujoco.MjModel:
    """Return a URDF as a model with all its links. Raises `InputError` if it is none."""
    with blaming("a robot's URDF cannot be read", (ValueError, mujoco.FatalError)):
        spec = mujoco.MjSpec.from_string(urdf)
        spec.compiler.fusestatic = False  # MuJoCo merges links without a joint into their parents
        for joint in spec.joints:
            if joint.type == _FREE and joint.parent.parent != spec.worldbody:  # URDF has no ball joint
                joint.type = _BALL
        return spec.compile()


class Links:
    """The links of one robot. Keeps the last position of joints that fall silent; one instance per run."""

    def __init__(self, header: SessionHeader, urdf: str) -> None:
        """Read a URDF of the header's robot. Raises `InputError` if it is none."""
        self._model = model = urdf_model(urdf)
        parents, names = model.body_parentid.copy(), [model.body(i).name for i in range(model.nbody)]
        model.body_parentid[:] = 0  # so that MuJoCo leaves each pose in the parent's frame
        self._data = mujoco.MjData(model)
        self.urdf = urdf
        self.frames = [(names[parents[i]], names[i]) for i in range(1, model.nbody)]
        """Parent and child of each link."""
        own = {model.joint(i).name: int(model.jnt_qposadr[i]) for i in range(model.njnt)}
        driven = [(own[name], i) for i, name in enumerate(header.joint_names) if name in own]
        self._driven, self._measured = np.array(driven, dtype=np.intp).reshape(-1, 2).T
        imu = str(json_document(header, "robot").get("imu", ""))
        link = names.index(imu) if imu in names else 0
        self._above_imu = []  # links from the IMU's up to the base, without it
        while parents[link]:
            self._above_imu.append(link)
            link = int(parents[link])
        is_floating = model.body_jntnum[link] and model.jnt_type[model.body_jntadr[link]] == _FREE
        self.base = link - 1 if is_floating else None
        """Row of `poses` that is the floating base; None where it is fixed."""

    @classmethod
    def of(cls, header: SessionHeader) -> Self | None:
        """Return the links that a header describes; None if it describes none."""
        urdf = header.documents.get(URDF_DOCUMENT)
        return None if urdf is None else cls(header, urdf)

    def poses(self, record: TickRecord) -> FloatArray:
        """Shape (k, 7), m and w x y z, of the links of `frames`, each in its parent's frame.

        Joints are as measured; passive ones, and a floating base, as simulated. Where that is not recorded, as on
        hardware, passive joints are at 0 and the base is at its place in the model, rotated as the IMU says.
        """
        model, data = self._model, self._data
        is_simulated = record.qpos is not None and len(record.qpos) >= model.nq
        if record.qpos is not None and is_simulated:  # what is simulated beside the robot comes behind it
            data.qpos[:] = record.qpos[: model.nq]
        measured = record.input.state.joint_position[self._measured]
        finite = np.isfinite(measured)
        data.qpos[self._driven[finite]] = measured[finite]
        mujoco.mj_kinematics(model, data)
        poses = np.concatenate([data.xpos[1:], data.xquat[1:]], axis=1)
        if self.base is not None and not is_simulated:
            quaternion = record.input.state.imu_quaternion
            for link in self._above_imu:
                quaternion = multiply(quaternion, conjugate(data.xquat[link]))
            poses[self.base, 3:] = quaternion
        return poses
