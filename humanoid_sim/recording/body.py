"""Poses of a recorded robot's links, from the URDF in the header and a tick's joint positions.

Nothing here needs the robot's MJCF, or MuJoCo: a recording carries its body with it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self
from xml.etree import ElementTree

import numpy as np

from humanoid_sim.controllers.rotation import conjugate, multiply, quaternion_from_matrix, rotate
from humanoid_sim.errors import blaming
from humanoid_sim.messages import QPOS_DOCUMENT, URDF_DOCUMENT, SessionHeader, TickRecord
from humanoid_sim.mit import FloatArray

_MOVING = ("revolute", "continuous", "prismatic")
_LARGEST = 16 << 20
"""Characters of a URDF."""


class BodyError(ValueError):
    """A header whose body cannot be used."""


@dataclass(frozen=True, slots=True, eq=False)
class UrdfJoint:
    """A joint of a URDF, and the link that it carries."""

    name: str
    kind: str
    parent: str
    child: str
    position: FloatArray
    """Shape (3,), position of the child in its parent's frame with the joint at 0, m."""
    quaternion: FloatArray
    """Shape (4,), w x y z, likewise."""
    axis: FloatArray
    """Shape (3,), child frame."""
    qpos: int
    """Index in `qpos` at which its value begins; -1 for a fixed joint."""


class RecordedBody:
    """The links of one robot. Keeps the last position of joints that fall silent; one instance per run."""

    def __init__(self, header: SessionHeader, urdf: str, addresses: Mapping[str, int], imu: str = "") -> None:
        """Read a URDF. Raises `BodyError` if it is none.

        The header names the joints of the state, `addresses` say where the value of each joint begins in `qpos`, and
        `imu` is the link that is the IMU; empty for none.
        """
        self.urdf = urdf
        joints = _joints(urdf, addresses)
        self.fixed = tuple(joint for joint in joints if joint.kind == "fixed")
        self.hinged = tuple(joint for joint in joints if joint.kind in _MOVING)
        self.floating = tuple(joint for joint in joints if joint.kind == "floating")
        self.joints = joints
        self._size = max((joint.qpos + (7 if joint.kind == "floating" else 1) for joint in joints), default=0)
        places = {name: i for i, name in enumerate(header.joint_names)}
        known = [(i, places[joint.name]) for i, joint in enumerate(self.hinged) if joint.name in places]
        self._ours = np.array([i for i, _ in known], dtype=np.intp)
        self._state = np.array([i for _, i in known], dtype=np.intp)
        self._qpos = np.array([joint.qpos for joint in self.hinged], dtype=np.intp)
        self._slides = np.array([joint.kind == "prismatic" for joint in self.hinged], dtype=bool)
        self._position = _stacked([joint.position for joint in self.hinged], 3)
        self._position.setflags(write=False)
        self._quaternion = _stacked([joint.quaternion for joint in self.hinged], 4)
        self._axis = _stacked([joint.axis for joint in self.hinged], 3)
        self._has_slides = bool(self._slides.any())
        self._along = rotate(self._quaternion, self._axis)
        half_turn = multiply(self._quaternion, np.insert(self._axis, 0, 0.0, axis=1))
        self._turned = np.where(self._slides[:, None], 0.0, half_turn)
        self._values = np.zeros(len(self.hinged))
        self._to_imu = _chain(joints, imu)

    @classmethod
    def of(cls, header: SessionHeader, documents: Mapping[str, str] | None = None) -> Self | None:
        """Return the body that a header, or these of its documents, describe; None if they describe none.

        Raises `BodyError` if what it says is damaged.
        """
        documents = header.documents if documents is None else documents
        if URDF_DOCUMENT not in documents:
            return None
        with blaming("'qpos_addresses' are no JSON", ValueError, BodyError):
            addresses = json.loads(documents.get(QPOS_DOCUMENT, "{}"))
        if not isinstance(addresses, dict) or not all(type(i) is int and 0 <= i < 10**6 for i in addresses.values()):
            raise BodyError("'qpos_addresses' are no JSON object of whole numbers")
        imu = str(json_document(documents, "robot").get("imu", ""))
        return cls(header, documents[URDF_DOCUMENT], addresses, imu)

    def joint_values(self, record: TickRecord) -> FloatArray:
        """Shape (J,), rad or m, of `hinged`: as measured, and of passive joints as simulated, or 0."""
        if record.qpos is not None and len(record.qpos) >= self._size:
            self._values[:] = record.qpos[self._qpos]
        measured = record.input.state.joint_position[self._state]
        heard = np.isfinite(measured)
        if heard.all():
            self._values[self._ours] = measured
        else:
            self._values[self._ours[heard]] = measured[heard]
        return self._values

    def hinged_poses(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the poses of the children of `hinged` in their parents' frames: (J, 3), m, and (J, 4), w x y z."""
        moved, straight, half = self._position, self._quaternion, (0.5 * values)[:, None]
        cos = np.cos(half)
        if self._has_slides:
            moved = moved + np.where(self._slides, values, 0.0)[:, None] * self._along
            cos = np.where(self._slides[:, None], 1.0, cos)
        return moved, cos * straight + np.sin(half) * self._turned

    def knows_base(self, record: TickRecord) -> bool:
        """Return whether the place of a floating base is known in a tick, and not only how it is turned."""
        return record.qpos is not None and len(record.qpos) >= self._size

    def floating_poses(self, record: TickRecord) -> FloatArray:
        """Shape (F, 7), m and w x y z, of the children of `floating`, in their parents' frames.

        As simulated; where that is not recorded, as on hardware, the base stands at its place in the model, turned as
        the IMU says.
        """
        poses = np.empty((len(self.floating), 7))
        for i, joint in enumerate(self.floating):
            poses[i, :3], poses[i, 3:] = joint.position, joint.quaternion
            if self.knows_base(record) and record.qpos is not None:
                is_ball = joint.parent != "world"
                own = record.qpos[joint.qpos : joint.qpos + (4 if is_ball else 7)]
                poses[i, 3:] = multiply(joint.quaternion, own) if is_ball else own[3:]
                poses[i, :3] = joint.position if is_ball else own[:3]
            elif self._to_imu and self._to_imu[0].parent == joint.child:
                poses[i, 3:] = multiply(record.input.state.imu_quaternion, conjugate(self._imu_in_base(record)))
        return poses

    def _imu_in_base(self, record: TickRecord) -> FloatArray:
        """Shape (4,), w x y z."""
        _, turned = self.hinged_poses(self.joint_values(record))
        by_name = {joint.name: turned[i] for i, joint in enumerate(self.hinged)}
        quaternion = np.array([1.0, 0.0, 0.0, 0.0])
        for joint in self._to_imu:
            quaternion = multiply(quaternion, by_name.get(joint.name, joint.quaternion))
        return quaternion


def json_document(documents: Mapping[str, str], name: str) -> dict[str, Any]:
    """Return a JSON object among a header's documents; empty where there is none, or a damaged one."""
    try:
        document = json.loads(documents.get(name, "{}"))
    except ValueError:
        return {}
    return document if isinstance(document, dict) else {}


def _chain(joints: tuple[UrdfJoint, ...], link: str) -> tuple[UrdfJoint, ...]:
    """Return the joints that lead to a link from what floats, or from the world; none for a link that there is not."""
    carrying = {joint.child: joint for joint in joints}
    chain: list[UrdfJoint] = []
    while link in carrying and carrying[link].kind != "floating" and len(chain) <= len(joints):
        chain.insert(0, carrying[link])
        link = carrying[link].parent
    return tuple(chain)


def _stacked(rows: list[FloatArray], width: int) -> FloatArray:
    return np.array(rows, dtype=np.float64).reshape(len(rows), width)


def _joints(urdf: str, addresses: Mapping[str, int]) -> tuple[UrdfJoint, ...]:
    if len(urdf) > _LARGEST:
        raise BodyError(f"the URDF has {len(urdf)} characters, expected at most {_LARGEST}")
    with blaming(
        "the URDF cannot be read",
        (ElementTree.ParseError, ValueError, KeyError, AttributeError, RecursionError),
        BodyError,
    ):
        root = ElementTree.fromstring(urdf)
        joints = tuple(_joint(element, addresses) for element in root.findall("joint"))
    for joint in joints:
        if not all(np.isfinite(values).all() for values in (joint.position, joint.quaternion, joint.axis)):
            raise BodyError(f"the URDF's joint '{joint.name}' is not finite")
    return joints


def _joint(element: ElementTree.Element, addresses: Mapping[str, int]) -> UrdfJoint:
    name, kind = element.attrib["name"], element.attrib["type"]
    parent, child = element.find("parent"), element.find("child")
    if parent is None or child is None:
        raise ValueError(f"joint '{name}' lacks a link")
    origin, axis = element.find("origin"), element.find("axis")
    place = {} if origin is None else origin.attrib
    return UrdfJoint(
        name,
        kind,
        parent.attrib["link"],
        child.attrib["link"],
        _three(place.get("xyz", "0 0 0")),
        _quaternion(_three(place.get("rpy", "0 0 0"))),
        _three("1 0 0" if axis is None else axis.attrib["xyz"]),
        -1 if kind == "fixed" else addresses.get(name, -1) if kind not in _MOVING else addresses[name],
    )


def _three(text: str) -> FloatArray:
    values = np.array([float(word) for word in text.split()])
    if values.shape != (3,):
        raise ValueError(f"'{text[:80]}' are not three numbers")
    return values


def _quaternion(rpy: FloatArray) -> FloatArray:
    """Shape (4,), w x y z, of roll, pitch and yaw about fixed axes."""
    (sr, cr), (sp, cp), (sy, cy) = ((math.sin(angle), math.cos(angle)) for angle in rpy)
    rotation = np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
    return quaternion_from_matrix(rotation)
