"""Datasets that `lerobot` writes become motions that play."""

import numpy as np
import pytest
from motion_samples import BODIES, joint_frames, joint_path, lite, prepare, refusal, state_of

from humanoid_sim.cli import run_program
from humanoid_sim.policy.motion import read_motion
from humanoid_sim.prepare import main

# The deprecation warnings of lerobot and of what it imports are not ours.
pytestmark = [pytest.mark.lerobot, pytest.mark.filterwarnings("ignore")]

ORDER = np.random.default_rng(2).permutation(14)


def write_dataset(root, episodes, names, fps=50):
    """A dataset made by the library: per episode, features as (F, …) arrays."""
    from lerobot.datasets.lerobot_dataset import LeRobotDataset  # noqa: PLC0415

    features = {
        key: {"dtype": "float32", "shape": value.shape[1:], "names": names.get(key)}
        for key, value in episodes[0].items()
    }
    dataset = LeRobotDataset.create("lab/dances", fps, features, root=root, robot_type="lite", use_videos=False)
    for episode in episodes:
        for i in range(len(next(iter(episode.values())))):
            dataset.add_frame({key: value[i].astype(np.float32) for key, value in episode.items()} | {"task": "dance"})
        dataset.save_episode()
    dataset.finalize()
    return root


def joints_and_bodies(q):
    """Joints in a permuted order, poses of the tracked bodies and the chest in the world."""
    state = state_of(q, ("chest", *BODIES))
    count = len(q)
    return {
        "observation.state": q[:, ORDER],
        "body_pos_w": state["body_pos_w"].reshape(count, -1),
        "body_quat_w": state["body_quat_w"].reshape(count, -1),
    }


NAMES = {
    "observation.state": [f"{lite().joint_names[i]}.pos" for i in ORDER],
    "body_pos_w": [f"{body}.{axis}" for body in ("chest", *BODIES) for axis in "xyz"],
}


def test_an_episode_becomes_a_motion(tmp_path, capsys):
    paths = [joint_path(30, seed) for seed in range(3)]
    root = write_dataset(tmp_path / "dances", [joints_and_bodies(path) for path in paths], NAMES)
    assert "--episode: missing, expected one of the 3 episodes" in refusal(capsys, tmp_path, root)
    assert "--episode: is 3" in refusal(capsys, tmp_path, root, "--episode", "3")
    assert prepare(tmp_path, root, "--episode", "1") == 0
    motion = read_motion(tmp_path / "out" / "dances_1.mcap")
    np.testing.assert_allclose(motion.frames, joint_frames(lite(), paths[1]), atol=2e-6)
    assert "5 bodies fit" in capsys.readouterr().out


def test_a_damaged_dataset(tmp_path, capsys):
    root = write_dataset(tmp_path / "dances", [joints_and_bodies(joint_path())], NAMES)
    file = next((root / "data").rglob("*.parquet"))
    file.write_bytes(file.read_bytes()[:-100])
    assert f"{root}: cannot be read as a LeRobot dataset" in refusal(capsys, tmp_path, root)


@pytest.mark.timeout(180)
def test_a_dataset_on_the_hub_while_offline(tmp_path, capsys):
    name = "lab/dances-that-nobody-has"
    assert f"'{name}' cannot be fetched from the hub" in refusal(capsys, tmp_path, name)


@pytest.mark.timeout(180)  # by itself the library asks again for hours
def test_wandb_without_a_network(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("WANDB_BASE_URL", "http://127.0.0.1:9")
    monkeypatch.setenv("WANDB_API_KEY", "0" * 40)
    monkeypatch.setattr("humanoid_sim.prepare.wandb_run._WAIT", 4.0)
    assert run_program(main, ["--wandb-run-path", "lab/arms/7xk2", "--output", str(tmp_path / "out")]) == 2
    assert "--wandb-run-path: run lab/arms/7xk2 cannot be read" in capsys.readouterr().err
