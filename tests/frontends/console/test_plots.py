import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from humanoid_sim.frontends.console.plots import MOST_CHARTS, History, Plots, Watch, bus_loads
from humanoid_sim.messages import Mode, PolicyStep
from humanoid_sim.recording.reader import open_recording
from humanoid_sim.recording.shadow import ShadowStep
from humanoid_sim.robots.description import RobotDescription

RECORDING = Path(__file__).parents[2] / "data" / "recordings" / "simulated_locomotion.mcap"


@pytest.fixture(scope="module")
def ticks():
    return list(open_recording(RECORDING).ticks())


@pytest.fixture
def plots():
    header = open_recording(RECORDING).header
    return Plots(header, RobotDescription.from_json(header.documents["robot"]), ["can0"])


def chart(plots, name):
    (index,) = [i for i, chart in enumerate(plots.charts) if f"{chart.group}: {chart.name}" == name]
    return index


def read(message):
    """As the page does: chart, whether it replaces what is there, and the table of times and series."""
    values = np.frombuffer(message, "<f8")
    return int(values[0]), bool(values[2]), values[3:].reshape(-1, int(values[1]))


def test_every_joint_term_and_bus_has_a_chart(plots):
    groups = {name: [c for c in plots.charts if c.group == name] for name in {c.group for c in plots.charts}}
    assert {name: len(charts) for name, charts in groups.items()} == {
        "position and command": 14,
        "velocity": 14,
        "effort": 14,
        "tracking error": 2,
        "loop": 2,
        "bus load": 1,
        "observation": 6,  # of 12, 24, 14, 14 and 14 values; 24 lines are too many for one
    }
    assert [c.name for c in groups["observation"]][:3] == [
        "motion_body_pos_b",
        "motion_body_ori_b, 1 to 20",
        "motion_body_ori_b, 21 to 24",
    ]
    assert all(1 <= len(c.series) <= 20 for c in plots.charts)


def test_a_joint_is_plotted_against_its_command(plots, ticks):
    for record in ticks[:100]:
        plots.add(record, {"can0": 0.25})
    index, is_whole, table = read(plots.message(chart(plots, "position and command: left_elbow_pitch"), 0))
    assert plots.charts[index].series == ("position", "command")
    assert is_whole
    assert table[0].tolist() == [record.input.state.time for record in ticks[:100]]
    assert table[1].tolist() == [record.input.state.joint_position[3] for record in ticks[:100]]
    assert table[2].tolist() == [record.output.command.position[3] for record in ticks[:100]]
    effort = read(plots.message(chart(plots, "effort: right_wrist_pitch"), 0))[2]
    assert effort[1].tolist() == [record.input.state.joint_effort[13] for record in ticks[:100]]
    assert set(read(plots.message(chart(plots, "bus load: can0"), 0))[2][1]) == {25.0}
    slowest = read(plots.message(chart(plots, "loop: tick time"), 0))[2]
    assert slowest[1].tolist() == pytest.approx([1e3 * record.duration for record in ticks[:100]])


def test_what_the_policy_observes_and_misses_is_plotted_while_it_drives(plots, ticks):
    for record in ticks:
        plots.add(record, {})
    driven = np.array([record.output.control_mode.mode is Mode.LOCOMOTION for record in ticks])
    assert 0 < driven.sum() < len(ticks)
    for name in ("observation: joint_pos", "tracking error: positions of bodies"):
        table = read(plots.message(chart(plots, name), 0))[2]
        assert np.isfinite(table[1:]).all(axis=0).tolist() == driven.tolist()
    steps = [record.output.policy_step for record in ticks if record.output.policy_step is not None]
    observed = read(plots.message(chart(plots, "observation: motion_body_pos_b"), 0))[2]
    assert observed[1:, driven][:, -1].tolist() == steps[-1].observation[:12].tolist()
    errors = read(plots.message(chart(plots, "tracking error: positions of bodies"), 0))[2][1:, driven]
    assert 0.0 < errors.max() < 50.0  # mm


def test_what_a_shadow_policy_would_command_is_plotted_beside_the_joint(ticks):
    header = open_recording(RECORDING).header
    told = {"observation_terms": [["joint_pos", 14], ["rest", 2]], "observation": {"joint_pos": header.joint_names}}
    told["action"] = list(header.joint_names[:3])
    shadowed = replace(header, documents={**header.documents, "shadow": json.dumps(told)})
    plots = Plots(shadowed, RobotDescription.from_json(header.documents["robot"]))
    names = [f"{chart.group}: {chart.name}" for chart in plots.charts]
    assert [name for name in names if "shadow" in name] == [
        *(f"shadow policy: {joint}" for joint in header.joint_names),
        "shadow policy: action",
        "shadow policy observes: joint_pos",
        "shadow policy observes: rest",
    ]
    command = replace(ticks[0].output.command, position=np.arange(14) / 10)
    for tick in (20, 40):  # said a little later than the ticks that it saw
        seen = PolicyStep(tick, np.arange(16, dtype=np.float32), np.array([1.0, 2.0, 3.0], dtype=np.float32))
        fault = "is NaN" if tick == 40 else ""
        plots.shadow(ShadowStep(tick, float(ticks[tick].input.state.time), seen, None if fault else command, fault))
    for record in ticks[:200]:
        plots.add(record, {})
    joint = read(plots.message(chart(plots, "shadow policy: left_elbow_pitch"), 0))[2]
    is_known = np.isfinite(joint[1])
    assert (is_known == np.isfinite(joint[2])).all()
    known = joint[:, is_known]
    times = [float(ticks[tick].input.state.time) for tick in (20, 40)]
    assert known[0].min() == times[0]
    assert known[0].max() < times[1]  # then it failed
    assert set(known[2]) == {0.3}
    assert known[1].tolist() == [
        tick.input.state.joint_position[3] for tick in ticks if tick.input.state.time in known[0]
    ]
    action = read(plots.message(chart(plots, "shadow policy: action"), 0))[2]
    shown = action[:, np.isfinite(action[1])]
    assert shown[1:, 0].tolist() == [1.0, 2.0, 3.0]
    assert shown[0].max() <= times[1] + 0.5 < action[0].max()  # what is old is not shown
    broken = replace(header, documents={**header.documents, "shadow": '{"observation_terms": [["a", -1]'})
    assert len(Plots(broken, RobotDescription.from_json(header.documents["robot"])).charts) == len(names) - 17


def test_fast_ticks_are_thinned_and_the_slowest_of_them_shown(plots, ticks):
    state = ticks[0].input.state
    for i in range(40):  # 200 Hz
        moved = replace(ticks[0].input, state=replace(state, time=0.005 * i))
        plots.add(replace(ticks[0], input=moved, duration=0.001 if i == 6 else 0.0001, overrun=i == 6), {})
    table = read(plots.message(chart(plots, "loop: tick time"), 0))[2]
    assert table[0].tolist() == pytest.approx(np.arange(0.0, 0.2, 0.02).tolist())
    assert table[1].tolist() == pytest.approx([0.1, 0.1, 1.0, *[0.1] * 7])
    assert read(plots.message(chart(plots, "loop: missed deadlines"), 0))[2][1].tolist() == [0, 0, *[1] * 8]


def test_the_history_is_bounded_and_begins_again_with_the_clock():
    history = History(2)
    assert history.since(0, slice(0, 2)).shape == (3, 0)
    for i in range(15_500):
        history.add(0.02 * i, np.array([i, -i], dtype=float))
    assert history.since(0, slice(1, 2))[1].tolist() == [-float(i) for i in range(500, 15_500)]
    assert history.since(15_499, slice(0, 2)).tolist() == [[pytest.approx(309.98)], [15_499.0], [-15_499.0]]
    history.add(0.0, np.zeros(2))  # reactivated
    assert history.since(0, slice(0, 2)).tolist() == [[0.0], [0.0], [0.0]]


def test_a_page_is_told_each_row_once_and_after_a_gap_all_that_is_left(plots, ticks):
    watch = Watch(plots)
    elbow, wrist = chart(plots, "effort: left_elbow_pitch"), chart(plots, "effort: left_wrist_yaw")
    assert watch.choose([elbow]) == ""
    assert list(watch.due()) == []
    plots.add(ticks[0], {})
    assert [read(message)[:2] for message in watch.due()] == [(elbow, True)]
    plots.add(ticks[1], {})
    plots.add(ticks[2], {})
    ((_, is_whole, table),) = [read(message) for message in watch.due()]
    assert not is_whole
    assert table[0].tolist() == [ticks[1].input.state.time, ticks[2].input.state.time]
    assert list(watch.due()) == []
    watch.choose([elbow, wrist])
    assert [(read(message)[0], read(message)[2].shape[1]) for message in watch.due()] == [(wrist, 3)]
    plots.history.oldest = plots.history.newest + 1  # more than is kept went by
    plots.add(ticks[3], {})
    assert [read(message)[1] for message in watch.due()] == [True, True]


@pytest.mark.parametrize("charts", [None, 3, "3", [1.0], [True], [-1], [10_000], [0] * 25, [[0]], {"0": 0}])
def test_charts_that_are_not_there_are_refused(plots, charts):
    watch = Watch(plots)
    assert watch.choose(charts) == f"plots not understood, expected at most {MOST_CHARTS} numbers from 0 to 52"


def test_the_load_of_a_bus_is_that_between_two_statuses():
    def status(frames, elapsed):
        counters = {"sent": frames, "received": frames}
        return {"channels": [{"source": "can0", "counters": counters, "elapsed": elapsed}]}

    # 1400 frames a second of 8 bytes and 131 to 160 bits each, on 1 Mbit/s
    assert bus_loads(status(5000, 10.0), status(5350, 10.5))["can0"] == pytest.approx(0.2037, abs=0.01)
    assert bus_loads(None, status(5000, 10.0)) == {}
    assert bus_loads(status(5000, 10.0), None) == {}
    assert bus_loads(status(5000, 10.0), status(5000, 10.0)) == {}
