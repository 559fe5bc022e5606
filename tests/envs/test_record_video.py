"""Gymnasium's RecordVideo around single and vector environments. moviepy wants an older Pillow than viser's viewer."""

import av
import gymnasium
import numpy as np
import pytest
from gymnasium import wrappers
from gymnasium.wrappers import vector

import humanoid_sim  # noqa: F401 - registers the environments

pytestmark = [pytest.mark.lerobot, pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::SyntaxWarning")]
NAME = "humanoid_sim/LiteTracking-v0"
OPTIONS = {"render_mode": "rgb_array", "width": 64, "height": 64, "max_episode_steps": 2}


def test_of_a_single_environment(tmp_path):
    folder = str(tmp_path / "videos")
    env = wrappers.RecordVideo(gymnasium.make(NAME, **OPTIONS), folder, episode_trigger=lambda _: True)
    env.reset(seed=0)
    for step in (1, 2):
        *_, truncated, _ = env.step(np.zeros(14, dtype=np.float32))
        assert truncated is (step == 2)
    env.close()
    assert _frames(tmp_path / "videos") == [(64, 64)] * 3


def test_of_a_vector_environment(tmp_path):
    made = gymnasium.make_vec(NAME, num_envs=2, threads=1, **OPTIONS)
    envs = vector.RecordVideo(made, str(tmp_path / "videos"), episode_trigger=lambda episode: episode == 0)
    envs.reset(seed=0)
    for _ in range(3):
        envs.step(np.zeros((2, 14), dtype=np.float32))
    envs.close()
    assert _frames(tmp_path / "videos") == [(64, 128)] * 3 or _frames(tmp_path / "videos") == [(128, 64)] * 3


def _frames(folder):
    """Height and width of every frame of the folder's one video, none of them of one colour."""
    (path,) = folder.glob("*.mp4")
    with av.open(str(path)) as container:
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    assert all(frame.std() > 5.0 for frame in frames)
    return [frame.shape[:2] for frame in frames]
