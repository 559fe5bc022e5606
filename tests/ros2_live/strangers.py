"""What ROS 2 nodes with default settings see of a session, and how they command it."""

import json
import math
import subprocess
from collections.abc import Mapping, Sequence
from typing import Any

from machines import ROOT, Machine, read_until

LATCHED = ("/safety_status", "/standby_controller_a/state", "/standby_controller_b/state", "/robot_description")
TYPES: Mapping[str, str] = {
    "/lite/joint_states": "sensor_msgs/msg/JointState",
    "/imu/data": "sensor_msgs/msg/Imu",
    "/control_mode": "humanoid_control_msgs/msg/ControlMode",
    "/safety_status": "humanoid_control_msgs/msg/SafetyStatus",
    "/standby_controller_a/state": "humanoid_control_msgs/msg/StandbyState",
    "/standby_controller_b/state": "humanoid_control_msgs/msg/StandbyState",
    "/robot_description": "std_msgs/msg/String",
    "/tf": "tf2_msgs/msg/TFMessage",
}
ACROSS = ("/lite/joint_states", "/imu/data", "/control_mode", "/robot_description", "/tf")
REMOTE = 4
COMMAND = "/remote_policy_controller/command"
_ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow_pitch", "wrist_yaw", "wrist_roll", "wrist_pitch")
JOINTS = tuple(f"{side}_{joint}" for side in ("left", "right") for joint in _ARM)


def listen(
    machine: Machine, messages: Mapping[str, str], seconds: float, *, until: Sequence[str] = (), **environment: str
) -> subprocess.Popen[str]:
    """Subscribe to all topics; `heard` gives what came, for some seconds and until certain topics have been heard."""
    topics = {topic: (kind, topic in LATCHED) for topic, kind in TYPES.items()}
    arguments = map(json.dumps, (seconds, until, topics))
    program = machine.ros("listen.py", *arguments, environment={**messages, **environment})
    read_until(program, "ready")
    return program


def heard(program: subprocess.Popen[str]) -> dict[str, Any]:
    """What a listener heard."""
    output, _ = program.communicate(timeout=90.0)
    assert program.returncode == 0, output
    return json.loads(output.splitlines()[-1])


def command(
    machine: Machine, messages: Mapping[str, str], position: float, **environment: str
) -> subprocess.Popen[str]:
    """Send commands for REMOTE until it is ended."""
    program = machine.ros("command.py", str(position), *JOINTS, environment={**messages, **environment})
    read_until(program, "ready")
    return program


def watch(machine: Machine, seconds: float = math.inf) -> subprocess.Popen[str]:
    """Watch a session's feed for some time, or until `ticks_of` is called."""
    program = machine.python("-c", TICKS, str(seconds), cwd=ROOT)
    read_until(program, "ready")
    return program


def ticks_of(program: subprocess.Popen[str]) -> list[dict[str, Any]]:
    """What a program that watches has seen, now that it ends."""
    output, _ = program.communicate(timeout=60.0)
    assert program.returncode == 0, output
    return [json.loads(line) for line in output.splitlines()]


def is_passive(tick: Mapping[str, Any]) -> bool:
    """Whether the joints are damped, as in REMOTE without commands."""
    return set(tick["stiffness"]) == {0.0} == set(tick["effort"]) and min(tick["damping"]) > 0.0


def passive_in_time(fed: list[dict[str, Any]]) -> bool:
    """Whether a command counted in no tick that began more than 100 ms after it had come, by the robot's clock."""
    late = [tick for tick in fed if tick["mode"] == REMOTE and tick["time"] - (tick["arrival"] or 0.0) > 0.1]
    assert late
    return all(is_passive(tick) for tick in late)


TICKS = """
import json, math, select, sys, time
from humanoid_sim.client import Feed, find_session
seconds, lines = float(sys.argv[1]), []
end = time.monotonic() + seconds
with Feed(find_session()) as feed:
    number = feed.wait(0, 10.0).number
    print("ready", flush=True)
    while time.monotonic() < end and not (seconds == math.inf and select.select([sys.stdin], [], [], 0)[0]):
        for sample in feed.since(number):
            number = sample.number
            tick = feed.decode(sample)
            lines.append(json.dumps({
                "stamp": 1e-9 * sample.stamp, "time": tick["time"], "mode": tick["mode"],
                "arrival": tick["remote"][0]["arrival_time"] if tick["remote"] else None,
                **{name: tick[f"command_{name}"].tolist() for name in ("position", "effort", "stiffness", "damping")},
                "joint_position": tick["joint_position"].tolist(),
            }))
        time.sleep(0.01)
print(*lines, sep="\\n")
"""
