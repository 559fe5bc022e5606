"""A robot on another machine, as its DDS topics show it: a feed of this process's own, for what reads feeds.

No program finds it as a session, and whatever is asked of it stays here: modes are changed on the robot's machine.
"""

from __future__ import annotations

import os
import signal
import socket
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np

from humanoid_sim.client import Feed, Intake, SessionInfo
from humanoid_sim.dds_client import JOINT_ARRAYS, Imu, stamp_ns
from humanoid_sim.errors import InputError, blaming
from humanoid_sim.frontends import require_packages
from humanoid_sim.frontends.attach import Attachment, attached, ready
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
from humanoid_sim.session.feed import MODEL_BLOB, FeedWriter
from humanoid_sim.session.registration import Registration

_PERIOD = 0.02
"""s between two messages of a robot's topics on hardware."""
_LOOK = 0.05
"""s between two looks for a robot."""
_SAFETY = SafetyStatus(SafetyLevel.WARNING, source="network", message="not known here: it stays on the robot's machine")
"""In the place of what never crosses a network."""
_KEEP_SHAPES = '<mujoco><compiler discardvisual="false"/></mujoco>'
"""MuJoCo drops what a URDF only shows."""


class Mirror:
    """Ticks from topics. For one thread."""

    def __init__(self, participant: Participant, prefix: str) -> None:
        """Subscribe; `prefix` is what the joint states are under."""
        self._states = Subscription(participant, ros.joint_states_topic(prefix), ros.Topic(JOINT_STATE))
        names = (ros.CONTROL_MODE_TOPIC, ros.DESCRIPTION_TOPIC, ros.IMU_TOPIC, ros.TF_TOPIC)
        self._mode, self._described, self._imu, self._frames = (
            Subscription(participant, name, ros.TOPICS[name]) for name in names
        )
        self._writer: FeedWriter | None = None
        self._shown = Mode.ZERO_TORQUE
        self._count = 0

    def is_there(self) -> bool:
        """Return whether a robot has said what it is, in which mode, and where its joints are."""
        latest = [topic.look() for topic in (self._states, self._mode, self._described)]
        return None not in latest

    def begin(self, folder: Path) -> tuple[FeedWriter, RobotDescription]:
        """Make a feed for the robot that is there, in a session's folder.

        Raises `InputError` if its description is not a URDF of a robot with these joints.
        """
        assert self._described.latest is not None
        assert self._states.latest is not None
        description, self._model = _described(self._described.latest["data"])
        names = tuple(self._states.latest["name"])
        if set(names) != set(description.joint_names):
            raise InputError(
                f"{ros.DESCRIPTION_TOPIC}: has the joints {', '.join(description.joint_names)}, expected those of the "
                f"joint states: {', '.join(names)}"
            )
        self._names = description.joint_names
        self._start = stamp_ns(self._states.latest)
        documents = {
            "robot": description.to_json(),
            "settings": "{}",
            URDF_DOCUMENT: self._described.latest["data"],
            QPOS_DOCUMENT: qpos_addresses(self._model),
        }
        self.header = SessionHeader(description.name, self._names, _PERIOD, self._start, documents)
        buffer = np.zeros(mujoco.mj_sizeModel(self._model), dtype=np.uint8)
        mujoco.mj_saveModel(self._model, None, buffer)
        self._writer = FeedWriter(folder, self.header, {MODEL_BLOB: buffer.tobytes()})
        self._publish()
        return self._writer, description

    def look(self) -> None:
        """Make a tick of what is new, if anything is."""
        for topic in (self._mode, self._imu, self._frames):
            topic.look()
        before = self._states.latest
        if self._states.look() is not before:
            self._publish()

    def _publish(self) -> None:
        record = self._record()
        if record is not None and self._writer is not None:
            self._writer.tick(record)
            self._count += 1

    def _record(self) -> TickRecord | None:
        """Return the robot as it is; None for joint states that are not this robot's."""
        told, mode = self._states.latest, self._mode.latest
        assert told is not None
        assert mode is not None
        places = {name: place for place, name in enumerate(told["name"])}
        if set(places) != set(self._names) or any(len(told[name]) != len(places) for name in JOINT_ARRAYS):
            return None
        order = [places[name] for name in self._names]
        position, velocity, effort = (np.asarray(told[name], np.float64)[order] for name in JOINT_ARRAYS)
        unknown = np.full(len(order), np.nan)  # commands are not on the network
        is_known = mode["mode"] in list(Mode)
        if is_known:
            self._shown = Mode(mode["mode"])
        warning = f"mode {mode['mode']} is not known here, the last known one is shown; update this program"
        words = [word for word in ("" if is_known else warning, mode["status_message"]) if word]
        shown = ControlMode(self._shown, mode["controller_name"], "; ".join(words))
        imu = (np.full(4, np.nan), np.full(3, np.nan), np.full(3, np.nan))
        if self._imu.latest is not None:
            sample = Imu.of(self._imu.latest)
            imu = (sample.quaternion, sample.angular_velocity, sample.linear_acceleration)
        time = 1e-9 * (stamp_ns(told) - self._start)
        state = MITState(time, position, velocity, effort, np.zeros(len(order)), *imu)
        command = MITCommand(unknown, unknown, unknown, unknown, unknown)
        return TickRecord(
            self._count, TickInput(state, (_SAFETY,)), TickOutput(command, shown), 0.0, False, self._qpos(position)
        )

    def _qpos(self, position: FloatArray) -> FloatArray:
        """MuJoCo's: the joints (n,), and a base that moves where `/tf` has it."""
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
    """Give the robot of a URDF with shapes and no files, as the bridge sends it. Raises `InputError` if it is none."""
    with blaming(f"{ros.DESCRIPTION_TOPIC}: is not a URDF", ElementTree.ParseError):
        root = ElementTree.fromstring(urdf)
    moves = any(joint.get("type") == "floating" for joint in root.iter("joint"))
    root.insert(0, ElementTree.fromstring(_KEEP_SHAPES))
    for link in root.iter("link"):
        for shape in link.findall("collision"):  # for planners; this image is only looked at
            link.remove(shape)
    with tempfile.TemporaryDirectory(prefix="humanoid_sim-") as name:
        folder = Path(name)
        source, target = folder / "robot.urdf", folder / "robot.xml"
        source.write_text(ElementTree.tostring(root, encoding="unicode"), encoding="utf-8")
        text = convert_urdf(source, "floating" if moves else "fixed", folder)
        target.write_text(text, encoding="utf-8")
        description = describe_mjcf(target)
        return description, bare_model(description)


@contextmanager
def mirrored(
    interface: str,
    prefix: str,
    *,
    told: Callable[[str], None] = lambda _: None,
    ended: Callable[[], bool] = lambda: False,
) -> Iterator[tuple[Attachment, Mirror] | None]:
    """Wait for a robot on a network interface, and attach to its image; None if it `ended` before.

    Raises:
        InputError: the interface cannot be used, or the robot describes itself wrongly.
        MissingPackageError: Cyclone DDS is not installed.
    """
    with ExitStack() as stack:
        participant = stack.enter_context(Participant(interface=interface))
        mirror = Mirror(participant, prefix)
        states = ros.joint_states_topic(prefix)
        told(f"waiting for a robot with {states} on {interface}, domain {participant.domain}")
        while not mirror.is_there():
            if ended():
                yield None
                return
            time.sleep(_LOOK)
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="humanoid_sim-")))
        registration = Registration.create(folder)
        stack.callback(registration.close)
        writer, description = mirror.begin(registration.path)
        stack.callback(writer.close)
        where = f"{interface}, domain {participant.domain}"
        session = _session(stack, registration, description.name, where)
        feed = stack.enter_context(Feed(session))
        intake = stack.enter_context(Intake(session, "mirror"))
        yield Attachment(session, feed, intake), mirror


@dataclass(frozen=True)
class RobotElsewhere:
    """Options of a front end that can also show a robot on another machine, for watching only."""

    session: int | None = None
    """Process id of the session. Default: the only one that runs."""
    dds: bool = False
    """Show a robot on another machine, from its DDS topics alone, for watching only."""
    interface: str = ""
    """With --dds: the network interface at which the robot is, such as eth1."""
    prefix: str = "lite"
    """With --dds: what the robot's joint states are under."""

    @contextmanager
    def shown(
        self, name: str, niceness: int = 5
    ) -> Iterator[tuple[Attachment, Callable[[], None] | None, Callable[[], bool]] | None]:
        """Attach the front end of that name to the session, or to the robot elsewhere, that the options name.

        Yields the attachment; of a robot elsewhere what takes in its newest messages; and what says that a signal asks
        this program to end. None if a signal came before that robot.

        Raises:
            InputError: options exclude each other, or there is no such session, robot or network interface.
            MissingPackageError: the front end's packages are not installed, or Cyclone DDS is not.
        """
        if self.interface and not self.dds:
            raise InputError(f"--interface: is {self.interface}, which means nothing without --dds")
        if self.session is not None and self.dds:
            raise InputError(f"--session: is {self.session}, which means nothing with --dds, whose robot is elsewhere")
        if self.dds and not self.interface:
            raise InputError("--interface: is needed with --dds: the one at which the robot is, such as eth1")
        require_packages(name)
        if not self.dds:
            with attached(self.session, name, niceness=niceness) as attachment:
                yield attachment, None, lambda: False
            return
        require_packages("dds")
        signals: list[int] = []
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda number, _: signals.append(number))

        def ended() -> bool:
            return bool(signals)

        with mirrored(self.interface, self.prefix, told=ready, ended=ended) as found:
            yield None if found is None else (found[0], found[1].look, ended)


def _session(stack: ExitStack, registration: Registration, robot: str, where: str) -> SessionInfo:
    """Return a session that no program finds, and that receives nothing."""
    for name in ("intents", "data"):
        stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)).bind(str(registration.path / name))
    return SessionInfo(os.getpid(), robot, "unknown", f"DDS on {where}", "", registration.path)
