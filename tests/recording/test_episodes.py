"""Stretches of a recording that become episodes of a dataset."""

from dataclasses import replace

import numpy as np
import pytest
from recorded_run import PERIOD, wobbled
from recording_samples import write_recording

from humanoid_sim.errors import InputError
from humanoid_sim.messages import Mode
from humanoid_sim.record_dataset import read_episodes
from humanoid_sim.recording.reader import open_recording


@pytest.fixture(scope="module")
def ticks():
    return list(wobbled()[1])


@pytest.fixture
def episodes(tmp_path):
    def episodes(ticks, fps=None):
        write_recording(tmp_path / "run.mcap", ticks, wobbled()[0])
        return list(read_episodes(open_recording(tmp_path / "run.mcap"), fps))

    return episodes


def in_mode(ticks, mode):
    return [tick for tick in ticks if tick.output.control_mode.mode is mode]


def changed(tick, **state):
    return replace(tick, input=replace(tick.input, state=replace(tick.input.state, **state)))


def test_one_episode_for_each_stretch_at_the_policys_rate(episodes, ticks):
    locomotion, remote = episodes(ticks)
    assert (locomotion.mode, locomotion.fps) == (Mode.LOCOMOTION, pytest.approx(25.0))  # a policy step every other tick
    assert (remote.mode, remote.fps) == (Mode.REMOTE, 50.0)
    steps = [tick.index for tick in in_mode(ticks, Mode.LOCOMOTION) if tick.output.policy_step is not None]
    assert [tick.index for tick in locomotion.ticks] == steps
    assert len(remote.ticks) == len(in_mode(ticks, Mode.REMOTE))


def test_another_rate(episodes, ticks):
    every, fifth = episodes(ticks, fps=50.0)[0], episodes(ticks, fps=10.0)[0]
    assert len(every.ticks) == len(in_mode(ticks, Mode.LOCOMOTION))
    assert [tick.index for tick in fifth.ticks] == [tick.index for tick in every.ticks[::5]]
    with pytest.raises(InputError, match="--fps: is 20, expected a divisor of its 50 ticks"):
        episodes(ticks, fps=20.0)


@pytest.mark.parametrize("gap", ["time", "ticks"])
def test_a_gap_ends_an_episode(episodes, ticks, gap):
    remote = in_mode(ticks, Mode.REMOTE)
    cut = remote[20].index
    late = [changed(tick, time=float(tick.input.state.time) + 3 * PERIOD) for tick in ticks[cut:]]
    _, before, after = episodes([*ticks[:cut], *(late if gap == "time" else ticks[cut + 3 :])])
    assert (len(before.ticks), len(after.ticks)) == (20, len(remote) - (20 if gap == "time" else 23))


def test_frames_begin_when_every_joint_was_received(episodes, ticks):
    silent = in_mode(ticks, Mode.REMOTE)[10]
    position = silent.input.state.joint_position.copy()
    position[3] = np.nan
    made = [*ticks[: silent.index], changed(silent, joint_position=position), *ticks[silent.index + 1 :]]
    assert [len(episode.ticks) for episode in episodes(made)[1:]] == [10, 39]
