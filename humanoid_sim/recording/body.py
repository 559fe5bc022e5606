"""Poses of a recorded robot's links, from the URDF in the header and a tick's joint positions.

Nothing here needs the robot's MJCF, or MuJoCo: a recording carries its body with it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self
from xml.etree import ElementTree

import numpy as np

from humanoid_sim.controllers.rotation import conjugate, multiply, rotate
from humanoid_sim.errors import InputError
from humanoid_sim.messages import QPOS_DOCUMENT, URDF_DOCUMENT, SessionHeader, TickRecord
from humanoid_sim.mit import FloatArray
from humanoid_sim.recording.header import json_document

_HINGED = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True, slots=True, eq=False)
class UrdfJoint:
    """A joint of a URDF, and the link that it carries."""

    name: str
    kind: str
    parent: str
    child: str
    position: FloatArray  # shape (3,), m, of the child in its parent's frame with the joint at 0
    quaternion: FloatArray  # shape (4,), w x y z, likewise
    axis: FloatArray  # shape (3,), child frame
    qpos: int  # index in `qpos` at which its value begins; -1 for a fixed joint


class RecordedBody:
    """The links of one robot. Keeps the last position of joints that fall silent; one instance per run."""

    def __init__(self, header: SessionHeader, urdf: str) -> None:
        """Read a URDF of the header's robot. Raises `InputError` if it is none."""
        addresses = json_document(header, QPOS_DOCUMENT)
        try:
            joints = [_joint(element, addresses) for element in ElementTree.fromstring(urdf).findall("joint")]
        except (ElementTree.ParseError, ValueError, KeyError, AttributeError) as error:
            raise InputError(f"recording: its robot's URDF cannot be read: {error}") from None
        self.urdf = urdf
        self.fixed = [joint for joint in joints if joint.kind == "fixed"]
        self.hinged = [joint for joint in joints if joint.kind in _HINGED]
        self.floating = [joint for joint in joints if joint.kind == "floating"]
        self.frames = [(joint.parent, joint.child) for joint in (*self.hinged, *self.floating)]
        """Parent and child of each link that moves."""
        self._size = max((joint.qpos + (7 if joint.kind == "floating" else 1) for joint in joints), default=0)
        own = [(i, joint.name) for i, joint in enumerate(self.hinged) if joint.name in header.joint_names]
        self._driven = np.array([i for i, _ in own], dtype=np.intp)
        self._state = np.array([header.joint_names.index(name) for _, name in own], dtype=np.intp)
        self._qpos = np.array([joint.qpos for joint in self.hinged], dtype=np.intp)
        self._values = np.zeros(len(self.hinged))
        self._position = np.array([joint.position for joint in self.hinged]).reshape(-1, 3)
        self._quaternion = np.array([joint.quaternion for joint in self.hinged]).reshape(-1, 4)
        axis = np.array([joint.axis for joint in self.hinged]).reshape(-1, 3)
        slides = np.array([joint.kind == "prismatic" for joint in self.hinged], dtype=bool)[:, None]
        self._along = np.where(slides, rotate(self._quaternion, axis), 0.0)
        self._turning = np.where(slides, 0.0, 0.5)
        self._turned = multiply(self._quaternion, np.insert(axis, 0, 0.0, axis=1))
        self._to_imu = _chain(joints, str(json_document(header, "robot").get("imu", "")))

    @classmethod
    def of(cls, header: SessionHeader) -> Self | None:
        """Return the body that a header describes; None if it describes none."""
        urdf = header.documents.get(URDF_DOCUMENT)
        return None if urdf is None else cls(header, urdf)

    def poses(self, record: TickRecord) -> FloatArray:
        """Shape (k, 7), m and w x y z, of the links of `frames`, each in its parent's frame.

        Joints are as measured; passive ones, and a floating base, as simulated. Where that is not recorded, as on
        hardware, passive joints are at 0 and the base is at its place in the model, turned as the IMU says.
        """
        qpos, known = record.qpos, self.knows_base(record)
        if known and qpos is not None:
            self._values[:] = qpos[self._qpos]
        measured = record.input.state.joint_position[self._state]
        finite = np.isfinite(measured)
        self._values[self._driven[finite]] = measured[finite]
        poses, count = np.empty((len(self.frames), 7)), len(self.hinged)
        half = self._turning * self._values[:, None]
        poses[:count, :3] = self._position + self._values[:, None] * self._along
        poses[:count, 3:] = np.cos(half) * self._quaternion + np.sin(half) * self._turned
        for pose, joint in zip(poses[count:], self.floating, strict=True):
            pose[:3], pose[3:] = joint.position, joint.quaternion
            if known and qpos is not None and joint.parent == "world":
                pose[:] = qpos[joint.qpos : joint.qpos + 7]
            elif known and qpos is not None:  # a ball joint
                pose[3:] = multiply(joint.quaternion, qpos[joint.qpos : joint.qpos + 4])
            elif self._to_imu and self._to_imu[0].parent == joint.child:
                pose[3:] = multiply(record.input.state.imu_quaternion, conjugate(self._imu_in_base(poses)))
        return poses

    def knows_base(self, record: TickRecord) -> bool:
        """Return True if a tick holds the place of a floating base, and not only its orientation."""
        return record.qpos is not None and len(record.qpos) >= self._size

    def _imu_in_base(self, poses: FloatArray) -> FloatArray:
        """Shape (4,), w x y z."""
        turned = {joint.name: poses[i, 3:] for i, joint in enumerate(self.hinged)}
        quaternion = np.array([1.0, 0.0, 0.0, 0.0])
        for joint in self._to_imu:
            quaternion = multiply(quaternion, turned.get(joint.name, joint.quaternion))
        return quaternion


def _chain(joints: list[UrdfJoint], link: str) -> list[UrdfJoint]:
    """Return the joints that lead to a link from a floating one, or from the world; none for an unknown link."""
    carrying = {joint.child: joint for joint in joints}
    chain: list[UrdfJoint] = []
    while link in carrying and carrying[link].kind != "floating":
        chain.insert(0, carrying[link])
        link = carrying[link].parent
    return chain


def _joint(element: ElementTree.Element, addresses: dict[str, int]) -> UrdfJoint:
    name, kind = element.attrib["name"], element.attrib["type"]
    parent, child, axis = (element.find(tag) for tag in ("parent", "child", "axis"))
    assert parent is not None
    assert child is not None
    origin = element.find("origin")
    place = {} if origin is None else origin.attrib
    return UrdfJoint(
        name,
        kind,
        parent.attrib["link"],
        child.attrib["link"],
        _vector(place.get("xyz", "0 0 0")),
        _quaternion(_vector(place.get("rpy", "0 0 0"))),
        _vector("1 0 0" if axis is None else axis.attrib["xyz"]),
        -1 if kind == "fixed" else addresses[name] if kind in _HINGED else addresses.get(name, -1),
    )


def _vector(text: str) -> FloatArray:
    return np.array([float(word) for word in text.split()])


def _quaternion(rpy: FloatArray) -> FloatArray:
    """Shape (4,), w x y z, of roll, pitch and yaw about fixed axes."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(0.5 * angle), math.sin(0.5 * angle)) for angle in rpy)
    roll, pitch, yaw = np.array([[cr, sr, 0.0, 0.0], [cp, 0.0, sp, 0.0], [cy, 0.0, 0.0, sy]])
    return multiply(yaw, multiply(pitch, roll))
