import json
from dataclasses import replace

import numpy as np
import pytest
import rig
from fakes import FakeRobot

from humanoid_sim.controllers.fsm import MODES
from humanoid_sim.frontends.console.state import FLAG_MEANINGS, Reasons, available_controllers, refusals, state
from humanoid_sim.messages import Intent, Mode, SafetyFlag, SafetyLevel, SafetyStatus, SessionHeader
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.floating_base import BaseObserver
from humanoid_sim.simulation.model import build_model

pytest.importorskip("mjviser", reason="viser and mjviser are not installed (extra 'console')")

from humanoid_sim.frontends.console.server import encoded

ALL = frozenset(MODES)


def test_the_controllers_are_those_of_the_header():
    documents = {"contract": "{}", "controllers": json.dumps({"remote": True, "guards": None})}
    assert available_controllers(SessionHeader("three", rig.JOINTS, 0.005, 0, documents)) == ALL
    none = available_controllers(SessionHeader("three", rig.JOINTS, 0.005, 0, {}))
    assert sorted(ALL - none) == ["remote_policy_controller", "rl_policy_controller"]


def test_what_would_be_refused_says_what_it_requires(local):
    damping = refusals(local.tick(Intent.DAMP), ALL)
    assert {intent for intent, text in damping.items() if not text} == {
        Intent.DAMP,
        Intent.LOAD_A,
        Intent.LOAD_B,
        Intent.QUIT,
    }
    assert damping[Intent.START_REMOTE] == "START_REMOTE refused: requires finished STANDBY, mode is DAMPING"
    standby = refusals(local.tick(Intent.LOAD_A), ALL)
    assert "standby_controller_a has not finished" in standby[Intent.START_LOCOMOTION]


def test_reactivate_is_offered_in_the_modes_in_which_the_session_grants_it(local):
    for intent, mode, refusal in (
        (None, "ZERO_TORQUE", ""),
        (Intent.DAMP, "DAMPING", ""),
        (Intent.LOAD_A, "STANDBY", "REACTIVATE refused: requires ZERO_TORQUE or DAMPING, mode is STANDBY"),
    ):
        told = state(local.tick(*(() if intent is None else (intent,))), ALL)
        offered = told["intents"]["reactivate"]
        assert (told["mode"], offered["name"], offered["refusal"]) == (mode, "REACTIVATE", refusal)
        assert offered["note"] == "checks and enables the motors afresh; starts at ZERO_TORQUE"
        simulated = state(replace(local.tick(), qpos=np.zeros(3)), ALL)["intents"]["reactivate"]
        assert simulated["note"] == "puts the simulated robot back to its start, in ZERO_TORQUE"
        served, _ = local.reactivation.serve(FakeRobot(), Mode[mode])
        assert served.startswith("reactivated: ") if not refusal else served == refusal


def test_it_foresees_what_the_session_then_decides(local):
    seen = set()
    record = local.tick()
    for asked in (Intent.LOAD_A, Intent.DAMP, Intent.START_REMOTE, Intent.LOAD_A, Intent.QUIT, *[None] * 8):
        foreseen = refusals(record, ALL)
        record = local.tick(*(() if asked is None else (asked,)))
        if asked is not None:
            assert list(record.output.refusals) == ([foreseen[asked]] if foreseen[asked] else [])
            seen.add(bool(foreseen[asked]))
    assert seen == {False, True}
    assert not refusals(record, ALL)[Intent.START_REMOTE]


def test_safety_is_explained(local):
    record = local.tick(Intent.DAMP)
    status = SafetyStatus(SafetyLevel.FAULT, SafetyFlag.MOTOR_FAULT | SafetyFlag.BUS_OFF, "can0", "over-current")
    told = state(replace(record, input=replace(record.input, safety=(status,))), ALL)
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
    joints = state(record, ALL)["joints"]
    assert joints["position"] == record.input.state.joint_position.tolist()
    assert joints["command"] == record.output.command.position.tolist()
    assert {len(values) for values in joints.values()} == {3}
    assert encoded({"x": [1.0, float("nan")], "y": float("inf")}) == '{"x":[1.0,null],"y":null}'
