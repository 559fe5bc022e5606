"""The message definitions of recordings, as `ros2msg` text: what ROS 2 tools need to decode a topic.

`humanoid_control_msgs` is wire-compatible with the ROS 2 stack and frozen. `humanoid_sim_msgs` is this project's own.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import NamedTuple

from humanoid_sim.messages import EventKind, Intent, Mode, SafetyLevel

SCHEMA_ENCODING = "ros2msg"

CLOCK = "rosgraph_msgs/msg/Clock"
FLOAT32_MULTI_ARRAY = "std_msgs/msg/Float32MultiArray"
JOINT_STATE = "sensor_msgs/msg/JointState"
IMU = "sensor_msgs/msg/Imu"
POSE_STAMPED = "geometry_msgs/msg/PoseStamped"
STRING = "std_msgs/msg/String"
TF_MESSAGE = "tf2_msgs/msg/TFMessage"
MIT_COMMAND = "humanoid_control_msgs/msg/MITCommand"
CONTROL_MODE = "humanoid_control_msgs/msg/ControlMode"
STANDBY_STATE = "humanoid_control_msgs/msg/StandbyState"
SAFETY_STATUS = "humanoid_control_msgs/msg/SafetyStatus"
EVENT = "humanoid_sim_msgs/msg/Event"
TICK = "humanoid_sim_msgs/msg/Tick"


def _constants(codes: Iterable[tuple[str, int]]) -> str:
    return "".join(f"uint8 {name} = {int(code)}\n" for name, code in codes)


_MODES = _constants((mode.name, mode) for mode in Mode)
_INTENTS = _constants((f"INTENT_{intent.name}", code) for code, intent in enumerate(Intent))

_TEXT = f"""\
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
MSG: rosgraph_msgs/Clock
builtin_interfaces/Time clock
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
MSG: std_msgs/MultiArrayDimension
string label
uint32 size
uint32 stride
MSG: std_msgs/MultiArrayLayout
std_msgs/MultiArrayDimension[] dim
uint32 data_offset
MSG: std_msgs/Float32MultiArray
std_msgs/MultiArrayLayout layout
float32[] data
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
MSG: geometry_msgs/PoseStamped
std_msgs/Header header
geometry_msgs/Pose pose
MSG: geometry_msgs/Transform
geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation
MSG: geometry_msgs/TransformStamped
std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform
MSG: tf2_msgs/TFMessage
geometry_msgs/TransformStamped[] transforms
MSG: std_msgs/String
string data
MSG: sensor_msgs/JointState
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
MSG: sensor_msgs/Imu
std_msgs/Header header
geometry_msgs/Quaternion orientation
float64[9] orientation_covariance
geometry_msgs/Vector3 angular_velocity
float64[9] angular_velocity_covariance
geometry_msgs/Vector3 linear_acceleration
float64[9] linear_acceleration_covariance
MSG: humanoid_control_msgs/MITCommand
std_msgs/Header header
string[] joint_names
float64[] position
float64[] velocity
float64[] effort
float64[] stiffness
float64[] damping
MSG: humanoid_control_msgs/ControlMode
std_msgs/Header header

{_MODES}
uint8 mode
string controller_name
string status_message
MSG: humanoid_control_msgs/StandbyState
std_msgs/Header header
uint32 current_segment
uint32 total_segments
float64 progress
bool is_finished
MSG: humanoid_control_msgs/SafetyStatus
std_msgs/Header header

{_constants((level.name, level) for level in SafetyLevel)}
uint8 level
string source
uint32 flags
string message
MSG: humanoid_sim_msgs/Event
# Something that happened outside the ticks.
{_constants((kind.name, kind) for kind in EventKind)}
float64 time    # s, robot's clock
string text
uint8 kind
MSG: humanoid_sim_msgs/Extern
# A named live input that is no joint state.
string name
float64 arrival_time    # s, robot's clock
float64 timeout         # s
uint32[] shape
float64[] value
MSG: humanoid_sim_msgs/RemoteCommand
# The latest accepted command from outside the control loop.
float64 arrival_time    # s, robot's clock
float64[] position
float64[] velocity
float64[] effort
float64[] stiffness
float64[] damping
MSG: humanoid_sim_msgs/Standby
float64 progress
uint32 current_segment
uint32 total_segments
bool is_finished
MSG: humanoid_sim_msgs/PolicyStep
# One inference: what the policy saw, and its raw answer.
int64 frame
float32[] observation
float32[] action
uint32[] action_shape    # of a policy that works, its length; others are refused with their shape
MSG: humanoid_sim_msgs/Safety
uint32 flags
uint8 level
string source
string message
MSG: humanoid_sim_msgs/Fault
# A controller that failed, and who took over.
string controller
string fallback
string message
bool is_bug
MSG: humanoid_sim_msgs/Tick
# One tick of the control loop: everything it depended on and everything it decided, bit for bit.
{_MODES}
{_INTENTS}
uint64 index
float64 time                                # s, robot's clock
float64 duration                            # s of wall time
float64[4] imu_quaternion                   # w x y z
float64[3] imu_angular_velocity             # rad/s, body frame
float64[3] imu_linear_acceleration          # m/s^2, body frame
bool overrun
bool quit
bool has_qpos
uint8 mode
float64[] joint_position                    # rad, joint frame
float64[] joint_velocity                    # rad/s
float64[] joint_effort                      # Nm
float64[] joint_age                         # s since the joint was last heard
float64[] command_position                  # rad, joint frame
float64[] command_velocity                  # rad/s
float64[] command_effort                    # Nm
float64[] command_stiffness                 # Nm/rad
float64[] command_damping                   # Nms/rad
float64[] qpos                              # MuJoCo's, at the time of the state
humanoid_sim_msgs/PolicyStep[] policy_step  # one if the policy ran, or none
humanoid_sim_msgs/Standby[] standby         # one in STANDBY, or none
humanoid_sim_msgs/RemoteCommand[] remote    # one, or none if there never was one
humanoid_sim_msgs/Extern[] extern
string controller_name
string status_message
humanoid_sim_msgs/Safety[] safety           # one per source
uint8[] intents
humanoid_sim_msgs/Fault[] faults
string[] refusals
string[] policy_error                       # what the policy raised, or none
string policy                               # selected in this tick, or empty
"""
_DEFINITIONS = dict(re.findall(r"^MSG: (\S+)\n(.*?)(?=^MSG: |\Z)", _TEXT, re.MULTILINE | re.DOTALL))

_TYPE = re.compile(r"^([a-z0-9_]+/[A-Za-z0-9]+)(\[\d*\])? ", re.MULTILINE)
_FIELD = re.compile(r"^([A-Za-z0-9_/]+)(\[\d*\])? +([a-z][a-z0-9_]*) *(?:#.*)?$", re.MULTILINE)


class MessageField(NamedTuple):
    """A field of a message definition."""

    name: str
    kind: str
    """A primitive, such as `float64`, or a message type, such as `std_msgs/msg/Header`."""
    length: int | None
    """None: a single value; 0: a sequence; else an array of that length."""


def message_fields(name: str) -> tuple[MessageField, ...]:
    """Return the fields of a message type (`package/msg/Type`) in their order; constants are none."""
    package, _, short = name.split("/")
    return tuple(
        MessageField(field, kind.replace("/", "/msg/"), int(brackets[1:-1] or 0) if brackets else None)
        for kind, brackets, field in _FIELD.findall(_DEFINITIONS[f"{package}/{short}"])
    )


def schema_text(name: str) -> str:
    """Give the definition of a message type (`package/msg/Type`), followed by those it depends on, as MCAP wants it."""
    package, _, short = name.split("/")
    texts: dict[str, str] = {}
    pending = [f"{package}/{short}"]
    while pending:
        key = pending.pop(0)
        if key not in texts:
            texts[key] = _DEFINITIONS[key]
            pending += [match[0] for match in _TYPE.findall(texts[key])]
    first, *others = texts.items()
    return first[1] + "".join(f"{'=' * 80}\nMSG: {key}\n{text}" for key, text in others)
