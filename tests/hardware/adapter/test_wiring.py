import msgspec
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.hardware.adapter.wiring import make_wiring

OFFSETS = {"left": 0.5, "right": -0.25}


def test_the_effort_limit_is_what_frames_can_say(description):
    strong = msgspec.structs.replace(description.joints[0], effort_limit=float("inf"))
    wiring = make_wiring(msgspec.structs.replace(description, joints=(strong, description.joints[1])), 2, OFFSETS)
    assert wiring.effort_limit.tolist() == [17.0, 10.0]


@pytest.mark.parametrize("count", [0, 3])
def test_channels_that_do_not_fit_the_buses_are_refused(count, description):
    with pytest.raises(InputError, match=rf"{count} channels given, expected 1, which carries all motors, or 2"):
        make_wiring(description, count, OFFSETS)


def test_a_joint_without_a_motor_is_refused(description):
    ghost = msgspec.structs.replace(description.joints[1], motor=None)
    with pytest.raises(InputError, match="these joints have no motor in the robot description: right"):
        make_wiring(msgspec.structs.replace(description, joints=(description.joints[0], ghost)), 1, OFFSETS)


def test_an_unknown_model_is_refused(description):
    joint = description.joints[1]
    assert joint.motor is not None
    strange = msgspec.structs.replace(joint, motor=msgspec.structs.replace(joint.motor, model="rs-09"))
    with pytest.raises(InputError, match=r"joint 'right': unknown motor model 'rs-09'; known: .*rs-00, rs-01"):
        make_wiring(msgspec.structs.replace(description, joints=(description.joints[0], strange)), 1, OFFSETS)


@pytest.mark.parametrize(
    ("calibration", "says"),
    [
        ({"left": 0.0}, "the calibration lacks right"),
        ({"left": 0.0, "right": 0.0, "middle": 0.0}, "has joints that the robot has not: middle"),
        ({"left": float("nan"), "right": 0.0}, "homing offset of left is nan"),
    ],
)
def test_a_calibration_of_another_robot_is_refused(calibration, says, description):
    with pytest.raises(InputError, match=says):
        make_wiring(description, 2, calibration)
