"""A robot on another machine, as its DDS topics show it, for watching only."""

from __future__ import annotations

import copy
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np

from humanoid_sim.client import monotonic_ns
from humanoid_sim.dds_client import JOINT_ARRAYS, Imu, stamp_ns
from humanoid_sim.errors import InputError, blaming
from humanoid_sim.frontends import require_packages
from humanoid_sim.frontends.attach import Source, Tick, attached
from humanoid_sim.messages import (
    QPOS_DOCUMENT,
    URDF_DOCUMENT,
    ControlMode,
    Mode,
    SafetyLevel,
    SafetyStatus,
    SessionHeader,
    TickInput,
    TickOutput,
    TickRecord,
)
from humanoid_sim.mit import FloatArray, MITCommand, MITState
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.mjcf import bare_model, describe_mjcf
from humanoid_sim.robots.urdf import convert_urdf, qpos_addresses
from humanoid_sim.ros2 import topics as ros
from humanoid_sim.ros2.dds.domain import Participant
from humanoid_sim.ros2.dds.endpoints import Subscription
from humanoid_sim.ros2.definitions import JOINT_STATE

_PERIOD = 0.02  # s between two messages of a robot's topics on hardware
_POLL = 0.05  # s between two checks for a robot
_SAFETY = SafetyStatus(SafetyLevel.WARNING, source="network", message="not known here: it stays on the robot's machine")
_KEEP_SHAPES = '<mujoco><compiler discardvisual="false"/></mujoco>'
"""MuJoCo drops what a URDF only shows."""


class Mirror(Source):
    """Ticks from topics. For one thread."""

    is_hardware = True

    def __init__(self, participant: Participant, prefix: str) -> None:
        """Wait for a robot whose joint states are under `prefix`.

        Raises `InputError` if its description is not a URDF of a robot with these joints.
        """
        states = ros.joint_states_topic(prefix)
        self._states = Subscription(participant, states, ros.Topic(JOINT_STATE))
        names = (ros.CONTROL_MODE_TOPIC, ros.DESCRIPTION_TOPIC, ros.IMU_TOPIC, ros.TF_TOPIC)
        self._mode, self._described, self._imu, self._frames = (
            Subscription(participant, name, ros.TOPICS[name]) for name in names
        )
        print(f"waiting for a robot with {states} on {participant.interface}, domain {participant.domain}", flush=True)
        while None in [topic.look() for topic in (self._states, self._mode, self._described)]:
            time.sleep(_POLL)
        assert self._described.latest is not None
        assert self._states.latest is not None
        urdf, self._newest = self._described.latest["data"], self._states.latest
        description, self._model = _described(urdf)
        names = tuple(self._newest["name"])
        if set(names) != set(description.joint_names):
            raise InputError(
                f"{ros.DESCRIPTION_TOPIC}: has the joints {', '.join(description.joint_names)}, expected those of the "
                f"joint states: {', '.join(names)}"
            )
        self._names, self._start = description.joint_names, stamp_ns(self._newest)
        documents = {
            "robot": description.to_json(),
            "settings": "{}",
            URDF_DOCUMENT: urdf,
            QPOS_DOCUMENT: qpos_addresses(self._model),
        }
        self.header = SessionHeader(description.name, self._names, _PERIOD, self._start, documents)
        self._shown, self._count = Mode.ZERO_TORQUE, 0
        self._where = f"{description.name} on {participant.interface}, domain {participant.domain}"

    def __str__(self) -> str:
        return self._where

    def is_running(self) -> bool:
        """Return True: nobody says that it ends."""
        return True

    def model(self) -> mujoco.MjModel:
        """Return a copy of the model."""
        return copy.copy(self._model)

    def ticks(self, timeout: float = 0.0) -> list[Tick]:
        """Return a tick where joint states have come."""
        self._states.reader.wait(timeout)
        for topic in (self._mode, self._imu, self._frames):
            topic.look()
        states = self._states.look()
        if states is self._newest or states is None:
            return []
        self._newest = states
        record = self._record()
        if record is None:
            return []
        self._count += 1
        self.latest = Tick(record, monotonic_ns())
        return [self.latest]

    def _record(self) -> TickRecord | None:
        """Return the robot as it is; None for joint states that are not this robot's."""
        states, mode = self._newest, self._mode.latest
        assert mode is not None
        places = {name: place for place, name in enumerate(states["name"])}
        if set(places) != set(self._names) or any(len(states[name]) != len(places) for name in JOINT_ARRAYS):
            return None
        order = [places[name] for name in self._names]
        position, velocity, effort = (np.asarray(states[name], np.float64)[order] for name in JOINT_ARRAYS)
        unknown = np.full(len(order), np.nan)  # commands are not on the network
        words = [mode["status_message"]]
        if mode["mode"] in list(Mode):
            self._shown = Mode(mode["mode"])
        else:
            words.insert(0, f"mode {mode['mode']} is not known here, the last known one is shown; update this program")
        shown = ControlMode(self._shown, mode["controller_name"], "; ".join(filter(None, words)))
        imu = (np.full(4, np.nan), np.full(3, np.nan), np.full(3, np.nan))
        if self._imu.latest is not None:
            sample = Imu.of(self._imu.latest)
            imu = (sample.quaternion, sample.angular_velocity, sample.linear_acceleration)
        state = MITState(
            1e-9 * (stamp_ns(states) - self._start), position, velocity, effort, np.zeros(len(order)), *imu
        )
        command = MITCommand(unknown, unknown, unknown, unknown, unknown)
        tick_input, output = TickInput(state, (_SAFETY,)), TickOutput(command, shown)
        return TickRecord(self._count, tick_input, output, 0.0, False, self._qpos(position))

    def _qpos(self, position: FloatArray) -> FloatArray:
        """Return MuJoCo's `qpos`: the joints (n,), and a base that moves where `/tf` has it."""
        qpos: FloatArray = self._model.qpos0.copy()
        for name, value in zip(self._names, position, strict=True):
            if np.isfinite(value):
                qpos[self._model.jnt_qposadr[self._model.joint(name).id]] = value
        if self._model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE and self._frames.latest is not None:
            base = self._model.body(int(self._model.jnt_bodyid[0])).name
            for frame in self._frames.latest["transforms"]:
                if frame["child_frame_id"] == base:
                    where, turn = frame["transform"]["translation"], frame["transform"]["rotation"]
                    pose = [*(where[axis] for axis in "xyz"), *(turn[axis] for axis in "wxyz")]
                    qpos[:7] = pose if np.isfinite(pose).all() else qpos[:7]
        return qpos


def _described(urdf: str) -> tuple[RobotDescription, mujoco.MjModel]:
    """Return the robot of a URDF with shapes and no files, as the bridge sends it. Raises `InputError` if not."""
    with blaming(f"{ros.DESCRIPTION_TOPIC}: is not a URDF", ElementTree.ParseError):
        root = ElementTree.fromstring(urdf)
    moves = any(joint.get("type") == "floating" for joint in root.iter("joint"))
    root.insert(0, ElementTree.fromstring(_KEEP_SHAPES))
    with tempfile.TemporaryDirectory(prefix="humanoid_sim-") as name:
        folder = Path(name)
        source, target = folder / "robot.urdf", folder / "robot.xml"
        source.write_text(ElementTree.tostring(root, encoding="unicode"), encoding="utf-8")
        text = convert_urdf(source, "floating" if moves else "fixed", folder)
        target.write_text(text, encoding="utf-8")
        description = describe_mjcf(target)
        return description, bare_model(description)


@dataclass(frozen=True)
class Watched:
    """Options of a front end that can also show a robot on another machine, for watching only."""

    session: int | None = None
    """Process id of the session. Default: the only one that runs."""
    dds: str = ""
    """A network interface such as eth1: show the robot there, from its DDS topics alone, for watching only."""
    prefix: str = "lite"
    """With --dds: what the robot's joint states are under."""

    @contextmanager
    def source(self, name: str, niceness: int = 5) -> Iterator[Source]:
        """Attach the front end of that name.

        Raises:
            InputError: there is no such session or network interface, or a robot describes itself wrongly.
            MissingPackageError: the front end's packages are not installed, or Cyclone DDS is not.
        """
        require_packages(name)
        if not self.dds:
            with attached(self.session, name, niceness=niceness) as attachment:
                yield attachment
            return
        if self.session is not None:
            raise InputError(f"--session: is {self.session}, which means nothing with --dds, whose robot is elsewhere")
        require_packages("dds")
        with Participant(interface=self.dds) as participant:
            yield Mirror(participant, self.prefix)
