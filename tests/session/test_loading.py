"""A policy put in place between two ticks, or not: what the session does with what was prepared."""

import json
from dataclasses import dataclass, field

import numpy as np
import pytest
import rig
from fakes import HEADER, FakeRobot, FakeSink, FakeSource, session
from local_session import ticking
from waiting import until

from humanoid_sim.client import LOAD, Intake, load_request
from humanoid_sim.controllers.rl_policy import RLPolicyController
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Intent, Mode
from humanoid_sim.mit import Extern
from humanoid_sim.session.intent_socket import IntentSocket
from humanoid_sim.session.loading import Loading, PreparedPolicy, load_refusal

OTHER = RLPolicyController(
    rig.JOINTS,
    rig.contract(joint_stiffness=[61.0, 62.0, 63.0]),
    rig.reference(),
    rig.good_answer,
    control_period=rig.PERIOD,
    extern={"velocity": 3},
)


@dataclass
class Desk:
    """Prepares `OTHER`, and notes what becomes of it."""

    done: list[str] = field(default_factory=list)
    problem: Exception | None = None

    def prepare(self, options):
        self.done.append(f"prepare {options}")
        if self.problem is not None:
            raise self.problem
        return PreparedPolicy(
            OTHER,
            HEADER,
            "policy loaded: other",
            follow=lambda: self.done.append("follow"),
            announce=lambda: self.done.append("announce"),
            discard=lambda: self.done.append("discard"),
        )


def test_the_policy_of_the_next_tick_is_the_one_that_was_loaded():
    """The memory goes on: STANDBY has arrived, and stays so."""
    desk, sink = Desk(), FakeSink()
    loading = Loading(desk.prepare)

    class Asking(FakeSource):
        def poll(self, now, output):
            if len(self.seen) == 7:
                assert loading.request("{}", output.control_mode.mode) == ""
                until(lambda: loading.is_ready)
            return super().poll(now, output)

    extern = {"velocity": Extern(np.zeros(3), 0.0)}
    source = Asking({0: (Intent.DAMP,), 1: (Intent.LOAD_A,), 9: (Intent.START_LOCOMOTION,)}, finish_at=12)
    loop = session(FakeRobot(extern=extern), intents=[source], sinks=[sink, loading], loading=loading)
    loop.run()
    modes = [record.output.control_mode.mode for record in sink.records[7:11]]
    assert modes == [Mode.STANDBY, Mode.STANDBY, Mode.LOCOMOTION, Mode.LOCOMOTION]
    assert sink.records[8].output.standby.is_finished
    assert sorted(sink.records[9].output.command.stiffness.tolist()) == [61.0, 62.0, 63.0]
    assert desk.done[:2] == ["prepare {}", "follow"]
    assert sink.events.count("policy loaded: other") == 1
    assert loop.controllers["rl_policy_controller"] is OTHER


@pytest.fixture
def desk():
    return Desk()


@pytest.fixture
def loading(desk):
    loading = Loading(desk.prepare)
    loading.start(HEADER)
    yield loading
    loading.close()


@pytest.mark.parametrize("mode", [Mode.LOCOMOTION, Mode.REMOTE])
def test_a_policy_that_is_ready_too_late_is_left(desk, loading, mode):
    assert loading.request("{}", Mode.STANDBY) == ""
    until(lambda: loading.is_ready)
    assert loading.take(mode) is None
    until(lambda: loading.answer)
    assert desk.done == ["prepare {}", "discard"]
    assert not loading.answer.granted
    assert loading.answer.text == load_refusal(mode)
    assert load_refusal(mode) == f"load refused: requires ZERO_TORQUE, DAMPING or STANDBY, mode is {mode.name}"
    assert loading.request("{}", mode) == load_refusal(mode)


def test_one_policy_is_loaded_at_a_time(desk, loading):
    assert loading.request("first", Mode.DAMPING) == ""
    assert loading.request("second", Mode.DAMPING) == "load refused: another policy is being loaded"
    until(lambda: loading.is_ready)
    assert loading.take(Mode.DAMPING) is not None
    until(lambda: loading.answer)
    assert loading.answer.granted
    assert desk.done == ["prepare first", "announce"]
    assert loading.request("third", Mode.DAMPING) == ""


@pytest.mark.parametrize(
    ("problem", "answer"),
    [
        (InputError("x.onnx: no such file"), "load refused: x.onnx: no such file"),
        (ZeroDivisionError("a bug"), "load failed: ZeroDivisionError: a bug"),
    ],
)
def test_what_goes_wrong_is_answered_and_the_next_is_taken(desk, loading, problem, answer):
    desk.problem = problem
    assert loading.request("{}", Mode.ZERO_TORQUE) == ""
    until(lambda: loading.answer)
    assert (loading.answer.granted, loading.answer.text) == (False, answer)
    assert not loading.is_ready
    desk.problem = None
    assert loading.request("{}", Mode.ZERO_TORQUE) == ""
    until(lambda: loading.is_ready)


def test_a_session_that_ends_leaves_what_was_prepared(desk):
    loading = Loading(desk.prepare, lambda: desk.done.append("cancel"))
    loading.start(HEADER)
    loading.request("{}", Mode.DAMPING)
    until(lambda: loading.is_ready)
    loading.close()
    assert desk.done == ["prepare {}", "cancel", "discard"]


def test_who_asks_over_the_intake_is_answered_when_it_is_loaded(local, desk, loading):
    local.intents.close()
    local.intents = IntentSocket(local.registration.intents, local.reactivation, local.told.append, loading=loading)
    local.stack.callback(local.intents.close)
    with Intake(local.info, "test") as intake, ticking(local) as records:
        token = intake.post(load_request("/x.onnx", motion="wave"))
        until(lambda: loading.is_ready)
        loading.take(records[-1].output.control_mode.mode)
        assert intake.answer(token, 20.0).text == "policy loaded: other"
        desk.problem = InputError("no such file")
        assert intake.load("/y.onnx").text == "load refused: no such file"
    assert json.loads(desk.done[0].removeprefix("prepare ")) == {"policy": "/x.onnx", "motion": "wave"}
    assert any(text.startswith("load requested by test (") for text in local.told)
    assert "load refused: no such file" in local.told


def test_a_session_that_loads_none_says_so(local):
    with Intake(local.info, "test") as intake, ticking(local):
        answer = intake.load("lite_tracking")
    assert not answer.granted
    assert answer.text.startswith("load refused: this session runs no policy but a shadow")


def test_a_request_names_files_by_absolute_paths(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "x.onnx").touch()
    word, _, text = load_request("x.onnx", motion="wave", command="0.3,0,0", song=None).partition(" ")
    assert word == LOAD
    assert json.loads(text) == {"policy": str(tmp_path / "x.onnx"), "motion": "wave", "command": "0.3,0,0"}
    told = r"^unknown option gait, expected one of policy, contract, motion, song, command$"
    with pytest.raises(ValueError, match=told):
        load_request("x.onnx", gait="trot")
