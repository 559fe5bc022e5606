"""A client of the original stack, as somebody who has never seen this project writes it: raw Cyclone DDS, nothing else.

Types and names are written out from the stack's message definitions; nothing of the package is imported.
"""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import make_idl_struct
from cyclonedds.idl.types import array, float32, float64, int32, sequence, uint8, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

LOOPBACK = """<CycloneDDS><Domain id="any">
<General><Interfaces><NetworkInterface name="lo" multicast="true"/></Interfaces></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>
<Peers><Peer address="127.0.0.1"/></Peers></Discovery></Domain></CycloneDDS>"""


def struct(name: str, /, **fields: Any) -> Any:
    """A message type, such as `std_msgs/Header`."""
    package, kind = name.split("/")
    return make_idl_struct(f"{kind}_", f"{package}::msg::dds_::{kind}_", fields)


numbers = sequence[float64]
Time = struct("builtin_interfaces/Time", sec=int32, nanosec=uint32)
Header = struct("std_msgs/Header", stamp=Time, frame_id=str)
String = struct("std_msgs/String", data=str)
MultiArrayDimension = struct("std_msgs/MultiArrayDimension", label=str, size=uint32, stride=uint32)
MultiArrayLayout = struct("std_msgs/MultiArrayLayout", dim=sequence[MultiArrayDimension], data_offset=uint32)
Float32MultiArray = struct("std_msgs/Float32MultiArray", layout=MultiArrayLayout, data=sequence[float32])
Vector3 = struct("geometry_msgs/Vector3", x=float64, y=float64, z=float64)
Quaternion = struct("geometry_msgs/Quaternion", x=float64, y=float64, z=float64, w=float64)
Transform = struct("geometry_msgs/Transform", translation=Vector3, rotation=Quaternion)
TransformStamped = struct("geometry_msgs/TransformStamped", header=Header, child_frame_id=str, transform=Transform)
TFMessage = struct("tf2_msgs/TFMessage", transforms=sequence[TransformStamped])
JointState = struct(
    "sensor_msgs/JointState", header=Header, name=sequence[str], position=numbers, velocity=numbers, effort=numbers
)
Imu = struct(
    "sensor_msgs/Imu",
    header=Header,
    orientation=Quaternion,
    orientation_covariance=array[float64, 9],
    angular_velocity=Vector3,
    angular_velocity_covariance=array[float64, 9],
    linear_acceleration=Vector3,
    linear_acceleration_covariance=array[float64, 9],
)
MITCommand = struct(
    "humanoid_control_msgs/MITCommand",
    header=Header,
    joint_names=sequence[str],
    **dict.fromkeys(("position", "velocity", "effort", "stiffness", "damping"), numbers),
)
ControlMode = struct(
    "humanoid_control_msgs/ControlMode", header=Header, mode=uint8, controller_name=str, status_message=str
)
StandbyState = struct(
    "humanoid_control_msgs/StandbyState",
    header=Header,
    current_segment=uint32,
    total_segments=uint32,
    progress=float64,
    is_finished=bool,
)
SafetyStatus = struct(
    "humanoid_control_msgs/SafetyStatus", header=Header, level=uint8, source=str, flags=uint32, message=str
)
TYPES: dict[str, Any] = {
    "rt/joint_states": JointState,
    "rt/imu/data": Imu,
    "rt/control_mode": ControlMode,
    "rt/safety_status": SafetyStatus,
    "rt/standby_controller_a/state": StandbyState,
    "rt/standby_controller_b/state": StandbyState,
    "rt/robot_description": String,
    "rt/tf": TFMessage,
    "rt/piano/key_state": Float32MultiArray,
    "rt/remote_policy_controller/command": MITCommand,
}
"""By topic; joint states under any prefix."""
_LATCHED = ("rt/safety_status", "rt/robot_description")


def type_of(topic: str) -> Any:
    return JointState if topic.endswith("/joint_states") else TYPES[topic]


def quality(topic: str, depth: int) -> Qos:
    latched = topic in _LATCHED or topic.endswith("/state")
    durability = Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile
    return Qos(Policy.Reliability.Reliable(100_000_000), Policy.History.KeepLast(depth), durability)


class Client:
    """A participant in a domain."""

    def __init__(self, domain: int) -> None:
        self.participant = DomainParticipant(domain)

    def reader(self, topic: str, depth: int = 10) -> DataReader:
        return DataReader(self.participant, Topic(self.participant, topic, type_of(topic)), quality(topic, depth))

    def writer(self, topic: str, depth: int = 4) -> DataWriter:
        return DataWriter(self.participant, Topic(self.participant, topic, type_of(topic)), quality(topic, depth))


@contextmanager
def client(domain: int) -> Iterator[Client]:
    configured = Domain(domain, LOOPBACK)
    try:
        yield Client(domain)
    finally:
        configured.__del__()  # and with it all that is in it


def until(condition: Any, what: str, timeout: float = 60.0) -> Any:
    """What a condition gives once it is true."""
    deadline = time.monotonic() + timeout

    def holds() -> Any:
        try:
            return condition()
        except IndexError:  # the library's, where somebody joins while it counts who is matched
            return None

    while not (found := holds()):
        assert time.monotonic() < deadline, f"not within {timeout:g} s: {what}"
        time.sleep(0.005)
    return found


def newest(reader: DataReader, timeout: float = 20.0) -> Any:
    """The newest sample, once there is one."""
    return until(lambda: reader.take(1000)[-1:], f"a sample of {reader.topic.name}", timeout)[0]


def command(names: Sequence[str], position: float = 0.0, **fields: Sequence[float]) -> Any:
    """A command that holds all joints at a position, stamped long ago: the stamp plays no part."""
    count = len(names)
    values = {
        "position": [position] * count,
        "velocity": [0.0] * count,
        "effort": [0.0] * count,
        "stiffness": [20.0] * count,
        "damping": [1.0] * count,
    }
    return MITCommand(Header(Time(1, 2), "anywhere"), list(names), **{**values, **fields})
