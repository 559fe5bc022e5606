"""Pictures that OpenGL draws: a video, and what environments render."""

import av
import gymnasium
import numpy as np
import pytest
from pendulum import PENDULUM
from records import record_of

import humanoid_sim.envs  # noqa: F401 - registers the environments
from humanoid_sim.mit import MITState
from humanoid_sim.rendering.poses import Poses
from humanoid_sim.rendering.video import write_video

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]


def test_a_second_of_ticks_is_a_second_of_video(tmp_path):
    poses = Poses()
    for index in range(101):
        poses.tick(record_of(MITState.unknown(1, 5.0 + index / 100), qpos=[index / 50]))
    write_video(tmp_path / "run.mp4", PENDULUM, poses, size=(160, 120))
    with av.open(str(tmp_path / "run.mp4")) as container:
        (stream,) = container.streams
        frames = [(float(frame.time), frame.to_ndarray(format="rgb24").astype(int)) for frame in container.decode()]
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
    assert [time for time, _ in frames] == pytest.approx(np.arange(26) / 25)
    assert np.abs(frames[0][1] - frames[25][1]).max() > 60, "the pendulum has moved"


def test_an_environment_renders_the_robot_as_it_is():
    env = gymnasium.make("humanoid_sim/LiteTracking-v0", render_mode="rgb_array")
    env.reset(seed=1)
    before = env.render()
    assert (before.shape, before.dtype) == ((480, 480, 3), np.uint8)
    for _ in range(20):
        env.step(np.full(14, 1.5, dtype=np.float32))
    assert (before != env.render()).any(axis=-1).mean() > 0.005
    env.close()
