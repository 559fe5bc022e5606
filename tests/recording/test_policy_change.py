"""A run that loaded another policy: its recording holds both, and is repeated with each in its time."""

from dataclasses import replace

import numpy as np
import pytest

from humanoid_sim.cli import run_program
from humanoid_sim.controllers.base import RL_POLICY
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Event, EventKind, Intent, SessionHeader, TickInput, TickRecord
from humanoid_sim.mit import MITState
from humanoid_sim.policy.checkpoint import placeholder_checkpoint
from humanoid_sim.policy.loaded_policy import load_policy
from humanoid_sim.policy.motion import MOTION_ATTACHMENT, Motion, motion_bytes, read_motion
from humanoid_sim.recording.reader import open_recording
from humanoid_sim.recording.recorder import McapRecorder
from humanoid_sim.recording.recover import recover
from humanoid_sim.recording.summary import summarize
from humanoid_sim.replay import main as replay_main
from humanoid_sim.robots.description import load_robot
from humanoid_sim.stack import build_supervisor, policy_controller, recorded_contract, run_header, with_policy

PERIOD = 0.02
LITE = load_robot("lite")
BEFORE, LOADED, END = 205, 260, 300
"""Ticks: START_LOCOMOTION without a policy, the replacement, and the last one; between them another one walks."""
INTENTS = {1: Intent.DAMP, 2: Intent.LOAD_A, BEFORE: Intent.START_LOCOMOTION, 215: Intent.START_LOCOMOTION}
INTENTS |= {250: Intent.DAMP, 252: Intent.LOAD_A, 458: Intent.START_LOCOMOTION}


def policy(observation, frame):
    return np.tanh(observation[:14]).astype(np.float32)


def loaded(observation):
    contract = replace(placeholder_checkpoint(LITE, policy_dt=2 * PERIOD).contract, observation=observation)
    return load_policy(contract, policy, None)


def entries():
    """A run without a policy that loads one of 28 values, and later one of 42 that has another rate."""
    supervisor = build_supervisor(LITE, PERIOD, None, loads=True)
    header = run_header(LITE, PERIOD, None, settings={"policy": None}, loads=True)
    yield header
    memory, position = supervisor.initial(), np.zeros(14)
    loads = {210: ("joint_pos", "joint_vel"), LOADED: ("joint_pos", "joint_vel", "actions")}
    for index in range(480):
        time = index * PERIOD
        if index in loads:
            chosen = loaded(loads[index])
            header = with_policy(header, chosen, None, settings={"policy": f"{len(loads[index])}.onnx"})
            controller = policy_controller(LITE, PERIOD, chosen)
            supervisor = replace(supervisor, controllers={**supervisor.controllers, RL_POLICY: controller})
            yield Event(time - PERIOD, f"policy loaded: {len(loads[index])}.onnx", EventKind.POLICY, header)
        state = MITState(time, position, *np.zeros((3, 14)), [1, 0, 0, 0], np.zeros(3), [0, 0, 9.81])
        given = TickInput(state, (), (INTENTS[index],) if index in INTENTS else ())
        memory, output = supervisor.step(memory, given)
        position = output.command.position
        yield TickRecord(index, given, output, 1e-4, False)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    path = tmp_path_factory.mktemp("run") / "run.mcap"
    write(path, list(entries()))
    return path


def write(path, items):
    header, *rest = items
    assert isinstance(header, SessionHeader)
    recorder = McapRecorder(path)
    recorder.start(header)
    for item in rest:
        if isinstance(item, TickRecord):
            recorder.tick(item)
        elif isinstance(item, Event):
            recorder.event(item)
    recorder.close()
    assert recorder.error is None


def test_it_is_repeated_bit_for_bit_with_each_policy_in_its_time(run, capsys):
    ticks = {tick.index: tick.output for tick in open_recording(run).ticks()}
    (refusal,) = ticks[BEFORE].refusals
    assert refusal == "START_LOCOMOTION refused: no policy is loaded: humanoid_sim.mode load POLICY loads one"
    assert run_program(replay_main, [str(run)]) == 0
    assert capsys.readouterr().out == "480 ticks, bit for bit identical\n"


def test_it_holds_what_each_policy_was_with_the_moment(run):
    recording = open_recording(run)
    assert recorded_contract(recording.header) is None
    changes = [entry for entry in recording.entries() if isinstance(entry, Event) and entry.header is not None]
    assert [round(event.time / PERIOD) + 1 for event in changes] == [210, LOADED]
    widths = [sum(width for _, width in recording.loaded(event).observation_terms) for event in changes]
    assert widths == [28, 42]
    assert [said.text for said in summarize(recording).remarks if said.kind == "event"] == [
        "policy loaded: 2.onnx",
        "policy loaded: 3.onnx",
    ]


def test_whoever_wants_one_policy_gets_the_steps_of_that_one(run):
    first, last = open_recording(run).of_last_policy(5.0), open_recording(run).of_last_policy()
    for recording, width in ((first, 28), (last, 42)):
        steps = [tick.output.policy_step for tick in recording.ticks()]
        assert len(steps) == 480
        widths = {len(step.observation) for step in steps if step is not None}
        assert widths == {width}
        assert sum(term for _, term in recording.header.observation_terms) == width
    assert all(tick.output.policy_step is None for tick in open_recording(run).ticks())


def test_a_recovered_file_replays_too(run, tmp_path):
    (tmp_path / "cut.mcap").write_bytes(run.read_bytes()[:-20_000])
    recover(tmp_path / "cut.mcap", tmp_path / "whole.mcap")
    assert run_program(replay_main, [str(tmp_path / "whole.mcap")]) == 0


def test_a_policy_that_was_lost_is_named(run, tmp_path):
    """A bit of its contract: the digest of its header is wrong, whatever else is sound."""
    data = bytearray(run.read_bytes())
    place = data.rfind(b'"observation":', 0, data.rfind(b"3.onnx"))
    data[data.find(b"joint_vel", place)] ^= 1
    (tmp_path / "damaged.mcap").write_bytes(data)
    recording = open_recording(tmp_path / "damaged.mcap")
    assert [entry.header is None for entry in recording.entries() if isinstance(entry, Event)] == [False, True]
    with pytest.raises(InputError, match=r"the policy that was loaded at 5\.18 s cannot be read: damaged"):
        recording.of_last_policy()
    assert run_program(replay_main, [str(tmp_path / "damaged.mcap")]) == 2


def test_a_recording_is_read_as_the_motion_of_its_last_policy(tmp_path):
    motions = [Motion(np.full((frames, 3), 0.5, np.float32), (), PERIOD) for frames in (3, 5)]
    header = run_header(LITE, PERIOD, None, settings={})
    headers = [replace(header, attachments={MOTION_ATTACHMENT: motion_bytes(motion)}) for motion in motions]
    tick = next(item for item in entries() if isinstance(item, TickRecord))
    write(tmp_path / "run.mcap", [headers[0], tick, Event(0.0, "loaded", EventKind.POLICY, headers[1])])
    assert len(read_motion(tmp_path / "run.mcap").frames) == 5
