"""`play --shadow`: a policy looks on, and the run is what it is without it."""

from contextlib import ExitStack
from dataclasses import replace
from itertools import pairwise

import pytest

from humanoid_sim import replay
from humanoid_sim.assets import SAMPLE_MOTION, SAMPLE_POLICY
from humanoid_sim.cli import run_program
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Mode
from humanoid_sim.play.options import PlayConfig
from humanoid_sim.play.plan import Plan
from humanoid_sim.recording.codec import TickEncoder
from humanoid_sim.recording.reader import open_recording
from humanoid_sim.recording.shadow import read_shadow_steps

SCRIPT = ("--script", "hold 0.1; damp; hold 0.2; load_a; wait; hold 0.2; damp; hold 0.1", "--video", "none")
SHADOW = ("--shadow", str(SAMPLE_POLICY), "--motion", SAMPLE_MOTION)


def control_log(result):
    encoder = TickEncoder(14)
    return [encoder.encode(replace(tick, duration=0.0, overrun=False)) for tick in result.ticks]


def test_it_is_recorded_and_changes_nothing(run, quick, folder):
    plain = run("--robot", quick, *SCRIPT)
    log = control_log(plain)
    result = run("--robot", quick, *SCRIPT, *SHADOW)
    assert (result.status, result.err) == (0, "")
    assert control_log(result) == log
    assert len(log) > 100
    assert f"shadow policy {SAMPLE_POLICY}: nothing of it reaches a motor" in result.out.replace("\n", "")
    steps = list(read_shadow_steps("r.mcap"))
    modes = {tick.index: tick.output.control_mode.mode for tick in result.ticks}
    assert {modes[step.tick] for step in steps} == {Mode.DAMPING, Mode.STANDBY}
    assert {step.fault for step in steps} == {""}
    summary = result.summary["shadow"]
    assert (summary["steps"], summary["faults"], summary["left_out"]) == (len(steps), 0, 0)
    assert (result.summary["policy"], {tick.output.policy_step for tick in result.ticks}) == (None, {None})
    recording = open_recording(folder / "r.mcap")
    for _ in recording.entries():
        pass
    topics = {topic.removeprefix("/humanoid_sim/shadow/"): count.messages for topic, count in recording.topics.items()}
    for topic in ("step", "mit_command", "action", "observation/joint_pos"):
        assert topics[topic] == len(steps) > 30
    assert {"shadow", "shadow_contract"} <= recording.header.documents.keys()
    assert "contract" not in recording.header.documents
    assert run_program(replay.main, ["r.mcap"]) == 0


def test_one_that_fails_changes_nothing_and_is_a_failure_of_the_run(run, quick):
    log = control_log(run("--robot", quick, *SCRIPT))
    result = run("--robot", quick, *SCRIPT, *SHADOW, "--action-limit", "1e-4")
    assert control_log(result) == log
    assert result.status == 1
    assert "failed: shadow policy: failed " in result.out
    assert result.summary["faults"] == []
    assert result.summary["shadow"]["faults"] > 10
    faults = [step.fault for step in read_shadow_steps("r.mcap") if step.fault]
    assert len(faults) == result.summary["shadow"]["faults"]
    told = [event.time for event in result.events if event.text.startswith("shadow policy: failed: action of ")]
    assert 1 < len(told) < 0.2 * len(faults)  # not all of them
    assert all(later - earlier > 0.99 for earlier, later in pairwise(told))


def test_the_control_stack_has_nothing_that_could_leave_the_two_modes():
    with ExitStack() as left:
        plan = Plan(PlayConfig(shadow=str(SAMPLE_POLICY), motion=SAMPLE_MOTION, viewer="none", record="none"), left)
        assert sorted(plan.supervisor.controllers) == [
            "damping_controller",
            "standby_controller_a",
            "standby_controller_b",
            "zero_torque_controller",
        ]
        assert [step.intent and step.intent.value for step in plan.steps or ()] == [
            None, "damp", None, "load_a", None, None, None, "damp", None,
        ]  # fmt: skip
        assert plan.description == Plan(PlayConfig(viewer="none", record="none"), left).description


STAYS = "but with --shadow the robot stays in DAMPING and STANDBY"
TWO_MODES = "means nothing with --shadow, whose robot stays in DAMPING and STANDBY"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"policy": "p.onnx"}, f"--policy: {TWO_MODES}"),
        ({"remote": "gravity"}, f"--remote: {TWO_MODES}"),
        ({"branch": "r.mcap@1"}, "--shadow: means nothing with --branch, which goes on as recorded"),
        ({"script": "damp; load_a; wait; start_locomotion"}, f"--script: has start_locomotion, {STAYS}"),
        ({"script": "motion"}, f"--script: has motion, {STAYS}"),
        ({"inject": "nan_policy@1"}, "--inject: nan_policy means nothing with --shadow: it is for a policy that"),
        ({"motion": None}, f"--motion: is missing; {SAMPLE_POLICY} is a tracking policy and follows a motion"),
        ({"shadow": "no.onnx"}, "no.onnx: no such file, expected an ONNX file"),
        (
            {"control_frequency": 25.0},
            "policy on robot 'lite': RLPolicyController.control_period: is 0.04 s, "
            "expected policy_dt (0.02 s) to be a whole multiple of it",
        ),
    ],
)
def test_what_does_not_go_with_it(run, changes, message):
    values = {"shadow": str(SAMPLE_POLICY), "motion": SAMPLE_MOTION, **changes}
    options = [word for name, value in values.items() if value for word in (f"--{name.replace('_', '-')}", str(value))]
    result = run(*options, record=False)
    assert result.status == 2
    assert message in result.err


def test_a_robot_without_gains_of_its_own_is_refused():
    config = PlayConfig(shadow="placeholder", robot="tests/data/hopper.xml", viewer="none", record="none")
    with pytest.raises(InputError, match=r"^--shadow: 'hopper' has no gains of its own to stand by, "):
        Plan(config, ExitStack())


def test_what_a_policy_did_not_drive_is_not_played_again(run, quick):
    run("--robot", quick, *SHADOW, "--script", "damp; hold 0.1")
    driven = "'r.mcap' was made with --shadow, and no policy drove its robot"
    for options, message in (
        (("--again", "r.mcap"), f"--again: {driven}; name one with --policy or --shadow"),
        (("--branch", "r.mcap@0.1", "--policy", "placeholder"), f"--branch: {driven}"),
    ):
        result = run(*options, record=False)
        assert (result.status, result.err) == (2, f"error: {message}\n")
    again = run("--again", "r.mcap", *SHADOW, "--script", "damp; hold 0.1", "--record", "none", record=False)
    assert (again.status, again.err) == (0, "")
    assert "shadow policy" in again.out
