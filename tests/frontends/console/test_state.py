import math
from dataclasses import replace

import numpy as np
import pytest
import rig
from fakes import FakeRobot

from humanoid_sim.controllers.fsm import MODES
from humanoid_sim.frontends.console.server import encoded
from humanoid_sim.frontends.console.state import (
    FLAG_MEANINGS,
    LoopRate,
    Reasons,
    base_velocity,
    known_supervisor,
    refusals,
    state,
)
from humanoid_sim.messages import Intent, Mode, RemoteCommand, SafetyFlag, SafetyLevel, SafetyStatus
from humanoid_sim.mit import Extern
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.floating_base import BaseObserver
from humanoid_sim.simulation.model import build_model
from humanoid_sim.stack import run_header

ALL = frozenset(MODES)
STACK = rig.supervisor()


def test_the_control_stack_is_that_of_the_header():
    biped = load_robot("lite_biped")
    for remote in (True, False):
        header = run_header(biped, 0.02, None, None, settings={}, remote=remote, needs_producer=True)
        told = known_supervisor(header)
        assert ("remote_policy_controller" in told.controllers) is remote
        assert told.needs_producer
    elsewhere = known_supervisor(replace(header, documents={"robot": header.documents["robot"]}))
    assert sorted(ALL - set(elsewhere.controllers)) == ["remote_policy_controller", "rl_policy_controller"]


def test_what_would_be_refused_says_what_it_requires(local):
    damping = refusals(local.tick(Intent.DAMP), STACK)
    assert {intent for intent, text in damping.items() if not text} == {
        Intent.DAMP,
        Intent.LOAD_A,
        Intent.LOAD_B,
        Intent.QUIT,
    }
    assert damping[Intent.START_REMOTE] == "START_REMOTE refused: requires finished STANDBY, mode is DAMPING"
    standby = refusals(local.tick(Intent.LOAD_A), STACK)
    assert "standby_controller_a has not finished" in standby[Intent.START_LOCOMOTION]


def test_remote_is_refused_beforehand_without_a_producer_where_the_base_floats(local):
    floating = replace(STACK, needs_producer=True)
    for intent in (Intent.DAMP, Intent.LOAD_A, *[None] * 6):
        record = local.tick(*(() if intent is None else (intent,)))
    offered = state(record, floating, is_simulated=True)["intents"]["start_remote"]
    assert offered["refusal"].startswith("START_REMOTE refused: no remote command within the last 100 ms")
    assert offered["why"].endswith("start a producer first")
    assert state(record, STACK, is_simulated=False)["intents"]["start_remote"]["refusal"] == ""
    for age, is_refused in ((0.05, False), (0.15, True)):
        sent = RemoteCommand(rig.command(), local.time - age)
        fed = replace(record, input=replace(record.input, remote=sent))
        assert bool(refusals(fed, floating)[Intent.START_REMOTE]) is is_refused


def test_the_loops_rate_is_measured_on_the_wall_clock():
    rate = LoopRate()
    for number in range(1, 300):
        rate.look(number, 5_000_000_000 + number * 25_000_000)  # 40 Hz, whatever the robot's clock does
        assert math.isnan(rate.value) if number < 41 else rate.value == pytest.approx(40.0)


def test_the_base_s_velocity_is_that_of_its_heading(local):
    biped = load_robot("lite_biped")
    model = build_model(biped)
    qpos = model.qpos0.copy()
    qpos[3:7] = np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)  # turned to the left by 90 degrees
    record = local.tick()
    moving = Extern(np.array([-0.2, 0.5, 0.0]), 0.0, 1.0)
    turning = replace(
        record.input.state, imu_angular_velocity=np.array([0, 0, 0.3]), extern={"base_linear_velocity": moving}
    )
    simulated = replace(record, input=replace(record.input, state=turning), qpos=qpos)
    observer = BaseObserver(model, biped)
    assert base_velocity(simulated, observer) == pytest.approx([0.5, 0.2, 0.3])
    on_hardware = base_velocity(simulated, None)  # whose `qpos` holds the joints that were measured
    assert on_hardware == pytest.approx([np.nan, np.nan, 0.3], nan_ok=True)


def test_reactivate_is_offered_in_the_modes_in_which_the_session_grants_it(local):
    for intent, mode, refusal in (
        (None, "ZERO_TORQUE", ""),
        (Intent.DAMP, "DAMPING", ""),
        (Intent.LOAD_A, "STANDBY", "REACTIVATE refused: requires ZERO_TORQUE or DAMPING, mode is STANDBY"),
    ):
        told = state(local.tick(*(() if intent is None else (intent,))), STACK, is_simulated=False)
        offered = told["intents"]["reactivate"]
        assert (told["mode"], offered["name"], offered["refusal"]) == (mode, "REACTIVATE", refusal)
        assert offered["note"] == "checks and enables the motors afresh; starts at ZERO_TORQUE"
        simulated = state(local.tick(), STACK, is_simulated=True)["intents"]["reactivate"]
        assert simulated["note"] == "puts the simulated robot back to its start, in ZERO_TORQUE"
        served, _ = local.reactivation.serve(FakeRobot(), Mode[mode])
        assert served.startswith("reactivated: ") if not refusal else served == refusal


def test_it_foresees_what_the_session_then_decides(local):
    seen = set()
    record = local.tick()
    for asked in (Intent.LOAD_A, Intent.DAMP, Intent.START_REMOTE, Intent.LOAD_A, Intent.QUIT, *[None] * 8):
        foreseen = refusals(record, STACK)
        record = local.tick(*(() if asked is None else (asked,)))
        if asked is not None:
            assert list(record.output.refusals) == ([foreseen[asked]] if foreseen[asked] else [])
            seen.add(bool(foreseen[asked]))
    assert seen == {False, True}
    assert not refusals(record, STACK)[Intent.START_REMOTE]


def test_safety_is_explained(local):
    record = local.tick(Intent.DAMP)
    status = SafetyStatus(SafetyLevel.FAULT, SafetyFlag.MOTOR_FAULT | SafetyFlag.BUS_OFF, "can0", "over-current")
    told = state(replace(record, input=replace(record.input, safety=(status,))), STACK, is_simulated=True)
    assert told["mode"] == "DAMPING"
    assert told["safety"] == [
        {
            "level": "FAULT",
            "source": "can0",
            "flags": [
                "BUS_OFF: a CAN interface has left its bus after too many errors",
                "MOTOR_FAULT: a motor reports a fault, or is not enabled",
            ],
            "message": "over-current",
        }
    ]
    assert told["intents"]["load_a"]["refusal"].startswith("LOAD_A refused: safety FAULT BUS_OFF|MOTOR_FAULT from can0")
    assert told["intents"]["load_a"]["why"] == "see Safety below"
    assert told["intents"]["damp"]["refusal"] == ""


def test_a_refusal_does_not_hide_why_the_robot_is_damped(local):
    reasons = Reasons(None)

    def told(*intents):
        record = local.tick(*intents)
        reasons.look(record)
        return reasons.told(record)["reason"]

    told(Intent.DAMP)
    told(Intent.LOAD_A)
    local.safety = (SafetyStatus(SafetyLevel.FAULT, SafetyFlag.MOTOR_FAULT, "can0", "over-current"),)
    fault = "safety FAULT MOTOR_FAULT from can0: over-current"
    assert told() == told(Intent.LOAD_A, Intent.START_REMOTE) == told() == fault
    local.safety = ()
    assert told(Intent.START_REMOTE) == fault
    assert told(Intent.LOAD_A) == "LOAD_A requested"


def test_a_robot_on_the_floor_has_fallen_in_every_mode(local):
    biped = load_robot("lite_biped")
    model = build_model(biped)
    stands, lies = model.qpos0.copy(), model.qpos0.copy()
    lies[2:7] = 0.1, 0.7, 0.0, 0.7, 0.0
    reasons, told = Reasons(BaseObserver(model, biped)), []
    local.enter_remote()
    for qpos in (stands, lies, stands, lies, None):
        record = replace(local.tick(Intent.DAMP) if qpos is None else local.tick(), qpos=lies if qpos is None else qpos)
        reasons.look(record)
        told.append(reasons.told(record)["fallen"])
    assert [text != "" for text in told] == [False, True, False, True, True]
    assert told[1] == "fell: tilted by 90°"


def test_every_flag_has_a_meaning():
    assert set(FLAG_MEANINGS) == set(SafetyFlag)


def test_joints_are_told_in_the_robots_order(local):
    record = local.tick(Intent.DAMP)
    joints = state(record, STACK, is_simulated=False)["joints"]
    assert joints["position"] == record.input.state.joint_position.tolist()
    assert joints["command"] == record.output.command.position.tolist()
    assert {len(values) for values in joints.values()} == {3}
    assert encoded({"x": [1.0, float("nan")], "y": float("inf")}) == '{"x":[1.0,null],"y":null}'
