"""Recordings become datasets that `lerobot` loads, value for value."""

import numpy as np
import pytest
from recorded_run import wobbled
from recording_samples import write_recording

from humanoid_sim.cli import run_program
from humanoid_sim.messages import Mode
from humanoid_sim.play import main as play
from humanoid_sim.record import main
from humanoid_sim.recording.reader import open_recording

pytestmark = [pytest.mark.lerobot, pytest.mark.filterwarnings("ignore")]


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Two seconds of the sample policy and of its end."""
    path = tmp_path_factory.mktemp("runs") / "wave.mcap"
    script = "damp; load_a; wait; start_locomotion; hold 2; damp; hold 0.2; quit"
    assert play(["--record", str(path), "--html", "none", "--viewer", "none", "--script", script]) == 0
    return path


def load(root):
    from lerobot.datasets.lerobot_dataset import LeRobotDataset  # noqa: PLC0415

    return LeRobotDataset("local/anything", root=root)


def test_lerobot_loads_what_was_recorded(tmp_path, recording):
    assert run_program(main, ["dataset", str(recording), "--output", str(tmp_path / "waves"), "--task", "wave"]) == 0
    dataset = load(tmp_path / "waves")
    opened = open_recording(recording)
    steps = [tick for tick in opened.ticks() if tick.output.policy_step is not None]
    assert (dataset.fps, dataset.num_episodes, len(dataset), dataset.meta.robot_type) == (50, 1, len(steps), "lite")
    names = [f"{joint}.pos" for joint in opened.header.joint_names]
    assert dataset.features["action"]["names"] == dataset.features["observation.state"]["names"] == names
    for i, tick in enumerate(steps):
        item, state = dataset[i], tick.input.state
        assert item["task"] == "wave"
        assert float(item["timestamp"]) == pytest.approx(i / 50.0, abs=1e-5)
        expected = {
            "observation.state": state.joint_position,
            "observation.velocity": state.joint_velocity,
            "observation.effort": state.joint_effort,
            "observation.imu": np.concatenate(
                [state.imu_quaternion, state.imu_angular_velocity, state.imu_linear_acceleration]
            ),
            "action": tick.output.command.position,
        }
        for key, values in expected.items():
            assert item[key].numpy().tobytes() == values.astype(np.float32).tobytes(), (i, key)


def test_several_recordings_and_modes(tmp_path):
    """A run with a policy that breaks and a remote that follows: one episode for each."""
    path = tmp_path / "modes.mcap"
    header, ticks = wobbled()
    write_recording(path, ticks, header)
    assert run_program(main, ["dataset", str(path), str(path), "-o", str(tmp_path / "set"), "--fps", "25"]) == 0
    dataset = load(tmp_path / "set")
    lengths = [int(dataset.meta.episodes[i]["length"]) for i in range(dataset.num_episodes)]
    remote = sum(tick.output.control_mode.mode is Mode.REMOTE for tick in ticks)
    assert len(lengths) == 4
    assert lengths[:2] == lengths[2:]
    assert lengths[1] == -(-remote // 2)
    tasks = [dataset[index]["task"] for index in (0, lengths[0])]
    assert tasks == ["run the policy placeholder", "follow remote commands"]
