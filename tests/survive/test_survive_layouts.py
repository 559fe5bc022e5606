"""Numbers, names and bytes that trained policies, other programs and old recordings depend on."""

from dataclasses import fields

import numpy as np
import pytest
from control_surface import dds_names, encode, encode_imu, topics

from humanoid_sim.messages import ControlMode, Intent, Mode, SafetyFlag, SafetyLevel, SafetyStatus, StandbyState
from humanoid_sim.mit import COMMAND_FIELDS, MITCommand, MITState


def test_numbers_and_words():
    assert [(mode.name, mode.value) for mode in Mode] == [
        ("ZERO_TORQUE", 0),
        ("DAMPING", 1),
        ("STANDBY", 2),
        ("LOCOMOTION", 3),
        ("REMOTE", 4),
    ]
    assert [(level.name, level.value) for level in SafetyLevel] == [
        ("OK", 0),
        ("WARNING", 1),
        ("FAULT", 2),
        ("CRITICAL", 3),
    ]
    assert [(flag.name, flag.value) for flag in SafetyFlag] == [
        ("BUS_OFF", 1),
        ("RX_TIMEOUT", 2),
        ("TX_QUEUE_OVERRUN", 4),
        ("MOTOR_FAULT", 8),
        ("TEMPERATURE_LIMIT", 16),
        ("INVALID_FRAME", 32),
    ]
    words = ["damp", "load_a", "load_b", "start_locomotion", "start_remote", "quit"]
    assert [intent.value for intent in Intent] == words
    assert [intent.name for intent in Intent] == [word.upper() for word in words]


def test_state_and_command_have_the_layout_that_policies_were_trained_with():
    five = ("position", "velocity", "effort", "stiffness", "damping")
    assert COMMAND_FIELDS == tuple(field.name for field in fields(MITCommand)) == five
    assert [field.name for field in fields(MITState)][:8] == [
        "time",
        "joint_position",
        "joint_velocity",
        "joint_effort",
        "joint_age",
        "imu_quaternion",
        "imu_angular_velocity",
        "imu_linear_acceleration",
    ]


TIME = 1_700_000_000_250_000_000
NAMES = ("neck_yaw", "left")
STATE = MITState(
    time=1.5,
    joint_position=[1.0, -2.0],
    joint_velocity=[0.5, 0.0],
    joint_effort=[0.25, -0.25],
    joint_age=[0.0, 0.0],
    imu_quaternion=[0.5, -0.5, 0.25, -0.25],  # w x y z; x y z w on the wire
    imu_angular_velocity=[1.0, 2.0, 3.0],
    imu_linear_acceleration=[0.0, 0.0, 9.81],
)
COMMAND = MITCommand([1.0, -2.0], [0.5, 0.0], [0.25, -0.25], [50.0, 30.0], [2.0, 1.0])
CDR, STAMP = "00010000", "00f15365 80b2e60e"
NAMES_HEX = "02000000 09000000 6e65636b5f79617700 000000 05000000 6c65667400 000000"
ARRAYS = (
    "02000000 00000000 000000000000f03f 00000000000000c0"
    "02000000 00000000 000000000000e03f 0000000000000000"
    "02000000 00000000 000000000000d03f 000000000000d0bf"
)
UNKNOWN = 9 * "0000000000000000"


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        (STATE, f"01000000 00 000000 {NAMES_HEX} {ARRAYS}"),
        (
            COMMAND,
            f"01000000 00 000000 {NAMES_HEX} {ARRAYS} 02000000 00000000 0000000000004940 0000000000003e40"
            "02000000 00000000 0000000000000040 000000000000f03f",
        ),
        (
            ControlMode(Mode.LOCOMOTION, "rl_policy_controller", "START_LOCOMOTION requested"),
            "01000000 00 03 0000 15000000 726c5f706f6c6963795f636f6e74726f6c6c657200 000000"
            "1b000000 53544152545f4c4f434f4d4f54494f4e2072657175657374656400",
        ),
        (StandbyState(1, 2, 0.75, False), "01000000 00 000000 01000000 02000000 000000000000e83f 00"),
        (
            SafetyStatus(SafetyLevel.FAULT, SafetyFlag.RX_TIMEOUT | SafetyFlag.MOTOR_FAULT, "can0", "left_elbow"),
            "0d000000 68756d616e6f69645f73696d00 02 0000 05000000 63616e3000 000000 0a000000"
            "0b000000 6c6566745f656c626f7700",
        ),
    ],
    ids=lambda value: type(value).__name__ if not isinstance(value, str) else "",
)
def test_messages_on_the_wire(message, expected):
    assert encode(message, TIME, NAMES).hex() == f"{CDR}{STAMP}{expected}".replace(" ", "")


def test_the_imu_on_the_wire():
    expected = (
        f"{CDR} {STAMP} 04000000 696d7500 000000000000e0bf 000000000000d03f 000000000000d0bf 000000000000e03f {UNKNOWN}"
        f"000000000000f03f 0000000000000040 0000000000000840 {UNKNOWN}"
        f"0000000000000000 0000000000000000 1f85eb51b89e2340 {UNKNOWN}"
    )
    assert encode_imu(STATE, TIME).hex() == expected.replace(" ", "")


def test_the_keys_of_a_piano_on_the_wire():
    keys = encode(np.array([1.0, 0.0, 0.5], np.float32), TIME)
    assert keys.hex() == f"{CDR} 00000000 00000000 03000000 0000803f 00000000 0000003f".replace(" ", "")


@pytest.mark.parametrize(
    ("topic", "kind", "depth", "is_latched"),
    [
        ("/remote_policy_controller/command", "humanoid_control_msgs/msg/MITCommand", 4, False),
        ("/control_mode", "humanoid_control_msgs/msg/ControlMode", 10, False),
        ("/standby_controller_a/state", "humanoid_control_msgs/msg/StandbyState", 1, True),
        ("/standby_controller_b/state", "humanoid_control_msgs/msg/StandbyState", 1, True),
        ("/safety_status", "humanoid_control_msgs/msg/SafetyStatus", 1, True),
        ("/lite/joint_states", "sensor_msgs/msg/JointState", 10, False),
        ("/imu/data", "sensor_msgs/msg/Imu", 10, False),
        ("/piano/key_state", "std_msgs/msg/Float32MultiArray", 1, False),
    ],
)
def test_topics(topic, kind, depth, is_latched):
    assert topics("lite")[topic] == (kind, depth, is_latched)
    package, name = kind.split("/msg/")
    assert dds_names(topic, kind) == (f"rt{topic}", f"{package}::msg::dds_::{name}_")
