"""Every fault in every mode, in virtual and in real time: the flag that the operator sees, and s until DAMPING."""

from dataclasses import replace

import pytest
from fault_rig import CAN_TIMEOUT, PERIOD, RealRig, VirtualRig
from motor_surface import short_waits

from humanoid_sim.hardware.mock.faults import FAULTS, Fault
from humanoid_sim.hardware.robstride.protocol import FrameType
from humanoid_sim.messages import Intent, Mode, SafetyFlag

ELBOW = ("left_elbow_pitch",)
STANDSTILL = 0.3
"""s"""
AFTERWARDS = 0.08
"""s that are watched after a fault is over."""
STALL = "host stalls"
BUS_OFF, RX_TIMEOUT = SafetyFlag.BUS_OFF, SafetyFlag.RX_TIMEOUT
MOTOR_FAULT, TEMPERATURE, INVALID = SafetyFlag.MOTOR_FAULT, SafetyFlag.TEMPERATURE_LIMIT, SafetyFlag.INVALID_FRAME

CASES = {
    "silent": (Fault("silent", ELBOW), RX_TIMEOUT, 0.24),
    "late": (Fault("late", ELBOW), RX_TIMEOUT, 0.24),
    "wrong_id": (Fault("wrong_id", ELBOW), RX_TIMEOUT, 0.24),
    "power lost": (Fault("brown_out", ELBOW, value=3.0), RX_TIMEOUT, 0.24),
    "brown_out": (Fault("brown_out", ELBOW), MOTOR_FAULT, 0.04),
    "motor_fault": (Fault("motor_fault", ELBOW), MOTOR_FAULT, 0.04),
    "over_temperature": (Fault("over_temperature", ELBOW), TEMPERATURE, 0.04),
    "encoder_jump": (Fault("encoder_jump", ELBOW), MOTOR_FAULT, 0.04),
    "garbage": (Fault("garbage", ELBOW), INVALID, 0.04),
    "second_master": (Fault("second_master"), INVALID, 0.04),
    "bus_off": (Fault("bus_off"), BUS_OFF, 0.04),
    STALL: (None, MOTOR_FAULT, STANDSTILL + 0.04),
}
"""By case: the fault, its flag, and s until DAMPING at most."""


SLACK = {VirtualRig: 0.0, RealRig: 0.06}
"""s that a machine may be late."""


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    short_waits(monkeypatch, answers=0.3, listening=0.005)


@pytest.fixture(params=[VirtualRig, pytest.param(RealRig, marks=pytest.mark.soak)], ids=["virtual", "real"])
def make_rig(request):
    return request.param


def test_every_fault_has_a_case():
    kinds = {fault.kind for fault, _, _ in CASES.values() if fault is not None}
    assert kinds == set(FAULTS) - {"stuck"}, "a stuck joint has no flag: its motion alone shows it"


@pytest.mark.parametrize("mode", Mode, ids=lambda mode: mode.name)
@pytest.mark.parametrize("name", CASES)
def test_a_fault_ends_in_damping(name, mode, make_rig):
    fault, flag, longest = CASES[name]
    harmless = Mode.ZERO_TORQUE if mode is Mode.ZERO_TORQUE else Mode.DAMPING
    with make_rig() as rig:
        rig.reach(mode)
        assert rig.is_harmless() == (mode is harmless), "there is something to fall"
        began = rig.robot.time
        if fault is None:
            rig.wait(STANDSTILL)
        else:
            began = rig.inject(replace(fault, duration=longest))
        ticks = [rig.tick() for _ in range(round((longest + AFTERWARDS) / PERIOD))]
        detected = next((tick for tick in ticks if not tick.is_ok), None)
        assert detected is not None, "never noticed"
        assert flag in detected.flags
        assert detected.time - began <= longest + SLACK[make_rig]
        assert {tick.mode for tick in ticks[ticks.index(detected) :]} == {harmless}, "from this tick on"
        assert rig.is_harmless(), "the motors as well"
        refused = rig.tick(Intent.LOAD_A)
        assert refused.mode is harmless or refused.is_ok


@pytest.mark.parametrize("name", ["wrong_id", "bus_off"])
def test_motors_that_no_command_reaches_stop_by_their_own_timeout(name, make_rig):
    fault = CASES[name][0]
    with make_rig() as rig:
        rig.reach(Mode.STANDBY)
        rig.inject(Fault(fault.kind, fault.joints))
        for _ in range(round(CAN_TIMEOUT / PERIOD) + 2):
            rig.tick()
        assert rig.is_harmless(fault.joints)


def test_a_few_lost_frames_are_tolerated(make_rig):
    with make_rig() as rig:
        rig.reach(Mode.LOCOMOTION)
        rig.inject(Fault("silent", value=0.1))
        ticks = [rig.tick() for _ in range(25)]
        assert all(tick.is_ok for tick in ticks), [tick.messages for tick in ticks if not tick.is_ok]
        assert {tick.mode for tick in ticks} == {Mode.LOCOMOTION}


def test_a_clear_that_is_lost_is_sent_again_though_reports_of_an_earlier_run_go_on(monkeypatch):
    clears = []

    def lossy(message, timeout=None):
        kind, motor = message.arbitration_id >> 24, message.arbitration_id & 0xFF
        is_clear = kind == FrameType.STOP and motor == 14 and message.data[:1] == b"\x01"
        if is_clear:
            clears.append(message)
        if kind != FrameType.ACTIVE_REPORT and not (is_clear and len(clears) == 1):
            send(message, timeout)

    with VirtualRig() as rig:
        rig.reach(Mode.DAMPING)
        rig.inject(Fault("motor_fault", ELBOW, duration=0.01))
        assert not [rig.tick(), rig.tick()][-1].is_ok
        send, rig.bus.runs = rig.bus.send, True
        monkeypatch.setattr(rig.bus, "send", lossy)
        rig.robot.activate()
        assert "had faults, cleared: " in "".join(rig.robot.checks.of("warning"))
