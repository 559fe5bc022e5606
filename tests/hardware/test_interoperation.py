"""An independent client, the PyPI package robstride-dynamics, drives the emulated motors over a bus.

Its scaling ranges are older than the manuals of 2026-04-28 and are patched to those; its host id is 0xFF. It opens
SocketCAN only, so it is handed a virtual bus.
"""

import time

import can
import numpy as np
import pytest
from robstride_dynamics import Motor, ParameterType, RobstrideBus
from robstride_dynamics import table as their_table

from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.motors import MOTORS

_CHANNEL = "interoperation"
_LITE = load_robot("lite")
ROBSTRIDES = [model for model in MOTORS.values() if model.family == "robstride"]
_MOTORS = {joint.name: joint.motor for joint in _LITE.joints if joint.motor is not None}


@pytest.fixture
def client(monkeypatch):
    for model in ROBSTRIDES:
        monkeypatch.setitem(their_table.MODEL_MIT_VELOCITY_TABLE, model.name, model.velocity)
        monkeypatch.setitem(their_table.MODEL_MIT_TORQUE_TABLE, model.name, model.effort)
    client = RobstrideBus(_CHANNEL, {name: Motor(motor.can_id, motor.model) for name, motor in _MOTORS.items()})
    client.channel_handler = bus = can.Bus(interface="virtual", channel=_CHANNEL)
    receive = bus.recv
    bus.recv = lambda timeout=None: receive(60.0 if timeout else timeout)  # its own 0.1 s are short where all is busy
    yield client
    client.disconnect(disable_torque=False)


def test_their_parameters_and_mit_frames_are_obeyed_and_their_readings_are_true(client, capsys):
    with MockServer(_LITE, [f"virtual:{_CHANNEL}"]) as motors:
        _drive(client, motors)
    assert "WARNING" not in capsys.readouterr().out.replace("WARNING: No calibration provided", "")


def _drive(client, motors):
    name = "left_wrist_yaw"
    assert (client.read(name, ParameterType.MODE), client.read(name, ParameterType.VBUS)) == (0, 48.0)
    client.write(name, ParameterType.TORQUE_LIMIT, 5.0)
    assert client.read(name, ParameterType.TORQUE_LIMIT) == 5.0
    client.enable(name)
    client.write_operation_frame(name, 0.0, 0.0, 0.0)
    start, *_ = client.read_operation_frame(name)
    deadline = time.monotonic() + 30.0
    position = start
    while abs(position - start - 0.3) > 0.02 and time.monotonic() < deadline:
        client.write_operation_frame(name, start + 0.3, 20.0, 0.5)
        position, velocity, torque, temperature = client.read_operation_frame(name)
        time.sleep(0.005)
    assert position == pytest.approx(start + 0.3, abs=0.02)
    assert abs(velocity) < 5.0
    assert abs(torque) < 5.5
    assert temperature == pytest.approx(25.0, abs=2.0)
    joint = _MOTORS[name].direction * motors.truth.joint_position[_LITE.joint_names.index(name)]
    turns = (position - joint) / (2.0 * np.pi)
    assert turns == pytest.approx(round(turns), abs=0.02)
    client.disable(name)
    client.write_operation_frame(name, start, 20.0, 0.5)  # a stopped motor answers, and does not obey
    still, _, effort, _ = client.read_operation_frame(name)
    assert effort == pytest.approx(0.0, abs=1e-3)
    assert still == pytest.approx(position, abs=0.1)
