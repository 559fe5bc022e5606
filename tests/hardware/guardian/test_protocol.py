from dataclasses import replace

import msgspec
import pytest

from humanoid_sim.errors import FieldError
from humanoid_sim.hardware.bus.address import BusAddress
from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.guardian.protocol import GuardedMotor, GuardianPlan

_LEFT, _RIGHT = BusAddress("socketcan", "can0"), BusAddress("udp_multicast", "ff15:7079:7468:6f6e::1")
_PLAN = GuardianPlan(
    (
        GuardedMotor(
            "left", _LEFT, (Frame(0x05061645, bytes(8)), Frame(0x05061609, b"\1" * 8)), (Frame(0x5061600, b"U"),)
        ),
        GuardedMotor("right", _RIGHT, (Frame(0x123, b"", is_extended=False),), (Frame(0x124, b"\xff"),)),
        GuardedMotor("left too", _LEFT, (Frame(1, b"\1"),), (Frame(2, b"\2"),)),
    ),
    timeout=0.15,
    damping_time=2.5,
    period=0.01,
    reset_rounds=7,
)


def test_a_plan_reaches_the_other_process_unchanged():
    text = msgspec.json.encode(_PLAN)
    assert b"\n" not in text
    assert msgspec.json.decode(text, type=GuardianPlan) == _PLAN


def test_each_channel_is_there_once():
    assert _PLAN.channels == (_LEFT, _RIGHT)


@pytest.mark.parametrize("name", ["timeout", "damping_time", "period"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf"), 61.0])
def test_times_that_protect_nothing_are_refused(name, value):
    with pytest.raises(FieldError, match=f"GuardianPlan.{name}: is {value}, expected more than 0 and at most"):
        replace(_PLAN, **{name: value})


def test_a_motor_that_would_not_be_braked_is_refused():
    bare = GuardedMotor("elbow", _LEFT, (Frame(1, b""),), ())
    with pytest.raises(FieldError, match="elbow has no frames for reset, expected at least one"):
        GuardianPlan((bare,))
    with pytest.raises(FieldError, match="reset_rounds: is 0, expected 1 or more"):
        replace(_PLAN, reset_rounds=0)
