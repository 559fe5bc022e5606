from dataclasses import replace

import numpy as np
import pytest
from recorded_run import PERIOD, wobbled
from recording_samples import write_recording

from humanoid_sim.errors import InputError
from humanoid_sim.messages import Mode
from humanoid_sim.recording.episodes import read_episodes
from humanoid_sim.recording.reader import open_recording

BOTH = frozenset((Mode.LOCOMOTION, Mode.REMOTE))


@pytest.fixture
def record(tmp_path):
    def record(ticks):
        write_recording(tmp_path / "run.mcap", ticks, wobbled()[0])
        return open_recording(tmp_path / "run.mcap")

    return record


def in_mode(ticks, mode):
    return [tick for tick in ticks if tick.output.control_mode.mode is mode]


def shifted(tick, seconds):
    state = replace(tick.input.state, time=float(tick.input.state.time) + seconds)
    return replace(tick, input=replace(tick.input, state=state))


def episodes(recording, modes=BOTH, fps=None):
    return list(read_episodes(recording, modes, fps))


def test_one_episode_for_each_stretch(record):
    ticks = list(wobbled()[1])
    locomotion, remote = episodes(record(ticks))
    assert (locomotion.mode, locomotion.fps) == (Mode.LOCOMOTION, pytest.approx(25.0))  # a policy step every other tick
    assert (remote.mode, remote.fps) == (Mode.REMOTE, 50.0)
    steps = [tick for tick in in_mode(ticks, Mode.LOCOMOTION) if tick.output.policy_step is not None]
    assert len(locomotion.ticks) == len(steps)
    assert [tick.index for tick in locomotion.ticks] == [tick.index for tick in steps]
    assert len(remote.ticks) == len(in_mode(ticks, Mode.REMOTE))


def test_another_rate(record):
    ticks = list(wobbled()[1])
    recording = record(ticks)
    every, fifth = episodes(recording, fps=50.0)[0], episodes(recording, fps=10.0)[0]
    assert len(every.ticks) == len(in_mode(ticks, Mode.LOCOMOTION))
    assert [tick.index for tick in fifth.ticks] == [tick.index for tick in every.ticks[::5]]
    with pytest.raises(InputError, match="--fps: is 20, expected a divisor of its 50 ticks"):
        episodes(recording, fps=20.0)


@pytest.mark.parametrize("gap", ["time", "ticks"])
def test_a_gap_ends_an_episode(record, gap):
    ticks = list(wobbled()[1])
    first = ticks.index(in_mode(ticks, Mode.REMOTE)[0])
    cut = first + 20
    late = [shifted(tick, 3 * PERIOD) for tick in ticks[cut:]]
    made = ticks[:cut] + (late if gap == "time" else ticks[cut + 3 :])
    _, before, after = episodes(record(made))
    assert len(before.ticks) == 20
    assert len(before.ticks) + len(after.ticks) == len(in_mode(made, Mode.REMOTE))


def test_frames_begin_when_every_joint_was_received(record):
    ticks = list(wobbled()[1])
    silent = in_mode(ticks, Mode.REMOTE)[10]
    position = silent.input.state.joint_position.copy()
    position[3] = np.nan
    state = replace(silent.input.state, joint_position=position)
    ticks[silent.index] = replace(silent, input=replace(silent.input, state=state))
    assert [len(episode.ticks) for episode in episodes(record(ticks), frozenset([Mode.REMOTE]))] == [10, 39]
