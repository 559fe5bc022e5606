"""A robot of two joints, its scripted motors, and short waits."""

import itertools

import pytest
from scripted_motors import ScriptedMotor, ScriptedMotors

from humanoid_sim.hardware.adapter import control
from humanoid_sim.hardware.adapter.robot import HardwareRobot
from humanoid_sim.hardware.bus import channel
from humanoid_sim.hardware.bus.address import BusAddress
from humanoid_sim.hardware.robstride import enabling, identification, requests, session
from humanoid_sim.robots import schema

_numbers = itertools.count()
_PATIENT = (0.05, 0.1, 0.2, 0.4, 0.4)


@pytest.fixture(autouse=True)
def short_waits(monkeypatch):
    """What takes a real bus milliseconds takes a virtual one less."""
    monkeypatch.setattr(enabling, "_LISTENING", 0.005)
    monkeypatch.setattr(channel, "_POLL", 0.005)
    monkeypatch.setattr(identification, "_QUIET", 0.01)
    monkeypatch.setattr(requests, "_ANSWER_TIMES", _PATIENT)
    monkeypatch.setattr(control, "_LONGEST", 0.05)


@pytest.fixture
def impatient(monkeypatch):
    """For tests in which a motor will not do what it is asked."""
    monkeypatch.setattr(requests, "_ANSWER_TIMES", (0.03, 0.03, 0.03))
    monkeypatch.setattr(enabling, "_LONGEST", 0.15)
    monkeypatch.setattr(session, "_REPORT_WAIT", 0.05)


@pytest.fixture
def attentive(monkeypatch):
    """For tests in which somebody answers whom nobody asks again."""
    monkeypatch.setattr(identification, "_QUIET", 0.1)


@pytest.fixture
def description():
    """`left` is an rs-02 on bus 0 that turns against its joint, `right` an rs-00 on bus 1."""
    left = schema.MotorDescription(bus=0, can_id=11, model="rs-02", direction=-1, torque_limit=17.0, current_limit=23.0)
    right = schema.MotorDescription(bus=1, can_id=21, model="rs-00", direction=1, torque_limit=10.0, current_limit=0.0)
    pose = schema.StandbySettings(
        target_stiffness=(50.0, 50.0), target_damping=(2.0, 2.0), segment_durations=(1.0,), pose_segments=((0.0, 0.0),)
    )
    gains = {"stiffness": 50.0, "damping": 2.0}
    return schema.RobotDescription(
        name="pair",
        mjcf="none.xml",
        imu="imu",
        joints=(
            schema.JointDescription(name="left", lower=-1.5, upper=1.0, effort_limit=17.0, motor=left, **gains),
            schema.JointDescription(name="right", lower=-0.5, upper=2.0, effort_limit=10.0, motor=right, **gains),
        ),
        initial_position=(0.0, 0.0),
        damping_controller=schema.DampingSettings(damping_scalar=3.0),
        standby_controller_a=pose,
        standby_controller_b=pose,
        remote_policy_controller=schema.RemoteSettings(damping_scalar=5.0),
    )


@pytest.fixture
def channels():
    """Two virtual channels of this test's own."""
    number = next(_numbers)
    return BusAddress("virtual", f"left-{number}"), BusAddress("virtual", f"right-{number}")


@pytest.fixture
def left():
    """Motor 11, 0.25 rad at the motor, so -0.25 rad at the joint without an offset."""
    return ScriptedMotor(11, position=0.25)


@pytest.fixture
def right():
    """Motor 21, at 0.5 rad."""
    return ScriptedMotor(21, "rs-00", uid=b"right uid"[:8], version=(0, 0, 3, 6), position=0.5)


@pytest.fixture
def motors(channels, left, right):
    """Both motors, powered."""
    with ScriptedMotors([(channels[0], [left]), (channels[1], [right])]) as motors:
        yield motors


@pytest.fixture
def make_robot(description, channels, motors, left, right, monkeypatch):
    """Makes robots on the two channels; at the end the motors obey again, and the robots are closed."""
    made = []

    def make(calibration=None, pair=description, **options):
        offsets = {"left": 0.0, "right": 0.0} if calibration is None else calibration
        robot = HardwareRobot(pair, channels, calibration=offsets, **options)
        made.append(robot)
        return robot

    yield make
    monkeypatch.setattr(requests, "_ANSWER_TIMES", _PATIENT)
    for motor in (left, right):
        motor.is_silent, motor.answers, motor.stops, motor.hears = False, True, True, lambda _: True
    for robot in made:
        robot.close()


@pytest.fixture
def robot(make_robot):
    """The pair, not activated."""
    return make_robot()
