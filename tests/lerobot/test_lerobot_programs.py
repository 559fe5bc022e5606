"""LeRobot's own programs, unchanged, on a running session: the plugins of `plugins/`."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import mujoco
import numpy as np
import pytest

from humanoid_sim.assets import asset_path
from humanoid_sim.cli import run_program
from humanoid_sim.client import Feed, Intake, SessionError, find_session
from humanoid_sim.messages import Mode
from humanoid_sim.play import main as play
from humanoid_sim.policy.motion import read_motion
from humanoid_sim.prepare import main as prepare
from humanoid_sim.record import main as record
from humanoid_sim.recording.reader import open_recording
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.kinematics import ForwardKinematics

pytestmark = [pytest.mark.lerobot, pytest.mark.filterwarnings("ignore"), pytest.mark.timeout(400)]

FPS, WIDTH, HEIGHT = 20, 96, 64
APPROACH = 5
"""Frames."""
SIZE = f"type: humanoid_sim, width: {WIDTH}, height: {HEIGHT}, fps: 10"
CAMERAS = f"--robot.cameras={{ego: {{{SIZE}, view: ego}}, outside: {{{SIZE}}}}}"
ROBOT = "--robot.type=humanoid_sim"
TO_REMOTE = "damp; load_b; wait; start_remote; hold 900"
TOLERANCE = 0.005
"""m between hands as they were recorded and replayed."""


@contextmanager
def session(recording, script=TO_REMOTE, mode=Mode.REMOTE):
    """A session of the simulated Lite in real time, once it is in a mode; gives its feed."""
    command = [sys.executable, "-m", "humanoid_sim.play", "--policy", "none", "--viewer", "none", "--html", "none"]
    command += ["--pace", "realtime", "--record", str(recording), "--script", script]
    with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL) as process:
        try:
            with Feed(wait_for(lambda: find_session(process.pid))) as feed:
                wait_for(lambda: mode_of(feed) is mode)
                yield feed
                with Intake(feed.session, "test") as intake:
                    intake.ask("damp")
                    wait_for(lambda: intake.ask("quit").granted)
            process.wait(60)
        finally:
            process.kill()


def wait_for(condition, seconds=90.0):
    """What the condition gives once it is true."""
    end = time.monotonic() + seconds
    while True:
        try:
            if given := condition():
                return given
        except SessionError:
            pass
        assert time.monotonic() < end
        time.sleep(0.1)


def mode_of(feed):
    sample = feed.latest()
    return None if sample is None else Mode(feed.decode(sample)["mode"])


def is_commanded(feed):
    """Whether joints follow a position; in the passive hold none does."""
    return bool(feed.decode(feed.latest())["command_stiffness"].any())


def start(name, *options):
    command = [sys.executable, "-m", f"lerobot.scripts.lerobot_{name}", *options]
    return subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)


def lerobot(name, *options):
    """Run a program of LeRobot's to its end; gives its status and what it printed."""
    with start(name, *options) as process:
        try:
            printed = process.communicate(timeout=300)[0].decode(errors="replace")
        finally:
            process.kill()
    return process.returncode, printed


def replay(root):
    """As `lerobot`, for the first episode of a dataset; without speech, for which LeRobot needs a program."""
    return lerobot("replay", ROBOT, *dataset_options(root, episode=0), "--play_sounds=false")


def dataset_options(root, **others):
    given = {"repo_id": f"local/{root.name}", "root": root, **others}
    return [f"--dataset.{name}={value}" for name, value in given.items()]


def recording_options(root, episodes, seconds):
    of_dataset = dataset_options(
        root, single_task="Raise the hands.", num_episodes=episodes, episode_time_s=seconds, reset_time_s=0.5,
        fps=FPS, push_to_hub="false", vcodec="h264",
    )  # fmt: skip
    return [ROBOT, CAMERAS, *of_dataset, "--play_sounds=false"]


@pytest.fixture(scope="module", autouse=True)
def home(tmp_path_factory):
    """Sessions and LeRobot's files in folders of their own; sockets need a short one."""
    with pytest.MonkeyPatch.context() as patch, tempfile.TemporaryDirectory() as folder:
        patch.setenv("XDG_RUNTIME_DIR", folder)
        patch.setenv("HF_HUB_OFFLINE", "1")
        patch.setenv("HF_LEROBOT_HOME", str(tmp_path_factory.mktemp("lerobot")))
        patch.setenv("CUDA_VISIBLE_DEVICES", "")
        yield


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A dataset of three episodes in which keys lead the hands, and the session's recording."""
    folder = tmp_path_factory.mktemp("recorded")
    with session(folder / "run.mcap"):
        keys = "--teleop.keys=" + 10 * "r." + 10 * "w." + "....2" + 10 * "a" + 100 * "." + "0" + 20 * "f"
        options = recording_options(folder / "reach", 3, 2.5)
        status, printed = lerobot("record", *options, "--teleop.type=humanoid_sim", keys)
    assert status == 0, printed[-3000:]
    return folder


def frames(root, episode):
    """Measured and commanded joints of an episode."""
    import pandas as pd  # noqa: PLC0415

    table = pd.concat([pd.read_parquet(path) for path in sorted((root / "data").rglob("*.parquet"))])
    table = table[table.episode_index == episode]
    return (np.stack(table[name].to_list()).astype(float) for name in ("observation.state", "action"))


def hands(q):
    return ForwardKinematics(load_robot("lite"))(q)[0]


def replayed_error(root, episode, recording):
    """Greatest distance, m, of the hands as replayed from each recorded frame, in the frames' order.

    The first frames are left out, in which the joints come from where they happened to be: a passive arm sinks.
    The loops of LeRobot and of the session are each paced by themselves, and lag where a machine is busy, so
    frames are matched to ticks in order, and not by the clock.
    """
    expected = hands(next(frames(root, episode)))[APPROACH:]
    ticks = [tick for tick in open_recording(recording).ticks() if tick.input.remote is not None]
    actual = hands(np.stack([tick.input.state.joint_position for tick in ticks]))
    # Each frame's tick is at or after the one before it, such that the largest error is least.
    distance = np.linalg.norm(expected[:, None] - actual[None], axis=-1).max(axis=-1)
    worst = distance[0]
    for row in distance[1:]:
        worst = np.maximum(np.minimum.accumulate(worst), row)
    return float(worst.min())


def test_three_episodes_with_videos(recorded):
    from lerobot.datasets.lerobot_dataset import LeRobotDataset  # noqa: PLC0415

    dataset = LeRobotDataset("local/reach", root=recorded / "reach", video_backend="pyav")
    assert (dataset.num_episodes, dataset.fps, dataset.meta.robot_type) == (3, FPS, "humanoid_sim")
    names = [f"{joint}.pos" for joint in load_robot("lite").joint_names]
    assert dataset.features["action"]["names"] == names
    assert dataset.features["observation.state"]["names"] == names
    first, last = dataset[0], dataset[40]
    for camera in ("ego", "outside"):
        shape = dataset.features[f"observation.images.{camera}"]["shape"]
        assert tuple(shape) == (HEIGHT, WIDTH, 3)
        before, after = (item[f"observation.images.{camera}"].numpy() for item in (first, last))
        assert before.std() > 0.02  # there is something to see
        assert camera == "ego" or np.abs(after - before).max() > 0.2  # the arms have moved


def test_keys_lead_the_hands(recorded):
    """10 presses of 5 mm up and forward; the commanded hands go where they are led."""
    _, action = frames(recorded / "reach", 0)
    path = hands(action)
    moved = path[-1] - path[0]
    assert moved[:, 2].min() > 0.03
    assert moved[:, 0].min() > 0.015


def test_a_replay_brings_the_hands_where_they_were(recorded):
    replayed = recorded / "replayed.mcap"
    with session(replayed) as feed:
        status, printed = replay(recorded / "reach")
        assert status == 0, printed[-3000:]
        assert mode_of(feed) is Mode.REMOTE
        wait_for(lambda: not is_commanded(feed), 5.0)
    assert replayed_error(recorded / "reach", 0, replayed) < TOLERANCE


def test_a_policy_is_trained_and_drives_the_robot(recorded, tmp_path):
    small = "--policy.dim_model=32 --policy.n_heads=2 --policy.dim_feedforward=64 --policy.chunk_size=20"
    status, printed = lerobot(
        "train", *dataset_options(recorded / "reach", video_backend="pyav"), "--policy.type=act",
        "--policy.device=cpu", "--policy.push_to_hub=false", "--policy.pretrained_backbone_weights=null",
        *small.split(), "--policy.n_action_steps=20", "--batch_size=2", "--steps=3", "--save_freq=3",
        "--num_workers=0", f"--output_dir={tmp_path / 'act'}",
    )  # fmt: skip
    assert status == 0, printed[-3000:]
    policy = tmp_path / "act" / "checkpoints" / "last" / "pretrained_model"
    with session(tmp_path / "driven.mcap"):
        options = recording_options(tmp_path / "eval_reach", 1, 2.0)
        status, printed = lerobot("record", *options, f"--policy.path={policy}", "--policy.device=cpu")
    assert status == 0, printed[-3000:]
    _, action = frames(tmp_path / "eval_reach", 0)
    driven = [tick for tick in open_recording(tmp_path / "driven.mcap").ticks() if tick.input.remote is not None]
    commanded = np.stack([tick.output.command.position for tick in driven])
    assert np.abs(commanded - action[-2]).max(axis=1).min() < 0.02


def test_a_dataset_becomes_a_motion_that_plays(recorded, tmp_path):
    policy, output = str(asset_path("policies", "lite_tracking.onnx")), tmp_path / "out"
    options = ["--policy", policy, "--motion", str(recorded / "reach"), "--episode", "0", "--resample"]
    assert run_program(prepare, [*options, "--output", str(output)]) == 0
    assert len(read_motion(output / "reach_0.mcap").frames) > 50
    options = ["--policy", policy, "--motion", str(output / "reach_0.mcap")]
    assert play([*options, "--record", "none", "--html", "none", "--viewer", "none"]) == 0


def test_a_run_becomes_a_dataset_that_replays(tmp_path):
    run, script = tmp_path / "wave.mcap", "damp; load_a; wait; start_locomotion; hold 2; damp; hold 0.2; quit"
    assert play(["--record", str(run), "--html", "none", "--viewer", "none", "--script", script]) == 0
    assert run_program(record, ["dataset", str(run), "-o", str(tmp_path / "wave"), "--fps", "25"]) == 0
    with session(tmp_path / "replayed.mcap"):
        status, printed = replay(tmp_path / "wave")
    assert status == 0, printed[-3000:]
    _, action = frames(tmp_path / "wave", 0)
    ticks = [tick for tick in open_recording(tmp_path / "replayed.mcap").ticks() if tick.input.remote is not None]
    commanded = np.stack([tick.output.command.position for tick in ticks])
    assert np.abs(commanded - action[-2]).max(axis=1).min() < 0.02


def test_connect_names_the_mode_that_is_missing(recorded, tmp_path):
    with session(tmp_path / "run.mcap", "damp; hold 900", Mode.DAMPING) as feed:
        status, printed = replay(recorded / "reach")
        assert status != 0
        assert "is in DAMPING, expected REMOTE; an operator enters it from STANDBY" in printed
        assert mode_of(feed) is Mode.DAMPING


@pytest.mark.parametrize("fate", [signal.SIGKILL, signal.SIGSTOP])
def test_a_client_that_is_lost_leaves_the_passive_hold(fate, tmp_path):
    teleoperate = ("teleoperate", ROBOT, "--teleop.type=humanoid_sim", "--teleop.keys=" + 100 * "r", "--fps=30")
    with session(tmp_path / "run.mcap") as feed, start(*teleoperate) as process:
        try:
            wait_for(lambda: is_commanded(feed))
            os.kill(process.pid, fate)
            wait_for(lambda: not is_commanded(feed), 5.0)
            time.sleep(0.3)
            assert not is_commanded(feed)
            assert mode_of(feed) is Mode.REMOTE
        finally:
            process.kill()
            process.communicate()


def test_connect_may_wait_and_the_end_of_remote_ends_it(tmp_path):
    from lerobot.utils.errors import DeviceNotConnectedError  # noqa: PLC0415
    from lerobot_robot_humanoid_sim import HumanoidSim, HumanoidSimConfig  # noqa: PLC0415

    options = dict.fromkeys(("velocities", "efforts", "imu"), True)
    with session(tmp_path / "run.mcap", "damp; load_b; wait; hold 900", Mode.STANDBY) as feed:
        robot = HumanoidSim(HumanoidSimConfig(wait_s=60.0, calibration_dir=tmp_path, **options))
        with Intake(feed.session, "operator") as intake, ThreadPoolExecutor() as threads:
            connected = threads.submit(robot.connect)
            wait_for(lambda: intake.ask("start_remote").granted)
            connected.result(60)
            wait_for(lambda: is_commanded(feed))  # held before the first action
            seen = robot.get_observation()
            assert list(seen) == list(robot.observation_features)
            assert len(seen) == 3 * 14 + 10
            action = {name: seen[name] for name in robot.action_features}
            assert robot.send_action(action) == action
            with pytest.raises(ValueError, match=r"left_elbow_pitch\.pos: is nan, expected a finite number"):
                robot.send_action(action | {"left_elbow_pitch.pos": np.nan})
            intake.ask("damp")
            with pytest.raises(DeviceNotConnectedError, match="is in DAMPING, expected REMOTE"):
                robot.send_action(action)
        robot.disconnect()


def test_actions_are_joined_by_lines_and_approached_after_a_pause():
    from lerobot_robot_humanoid_sim.sender import Trajectory  # noqa: PLC0415

    path = Trajectory(approach_speed=1.0, stale_after=0.1)
    path.add(np.array([0.2, 0.0]), np.zeros(2), 10.0)
    assert path.position(10.0).tolist() == [0.0, 0.0]
    assert path.position(10.1) == pytest.approx([0.1, 0.0])
    for i in range(1, 11):
        path.add(np.array([0.2, 0.1 * i]), np.full(2, np.nan), 10.0 + 0.05 * i)
    assert path.position(10.525) == pytest.approx([0.2, 0.95])
    assert path.position(10.6) == pytest.approx([0.2, 1.0])
    assert path.age(10.55) == pytest.approx(0.0, abs=1e-9)
    assert path.age(10.65) == pytest.approx(0.1)
    path.add(np.array([0.2, 1.0]), np.array([0.2, 0.5]), 12.0)
    assert path.position(12.0) == pytest.approx([0.2, 0.5])
    assert path.position(12.25) == pytest.approx([0.2, 0.75])
    assert path.position(13.0) == pytest.approx([0.2, 1.0])


def test_slow_loops_keep_their_actions_in_force_until_the_next():
    from lerobot_robot_humanoid_sim.sender import Trajectory  # noqa: PLC0415

    path = Trajectory(approach_speed=1.0, stale_after=0.1)
    for i in range(4):
        path.add(np.array([0.1 * i]), np.array([0.1 * (i - 1)]), 0.2 * i)
    assert path.age(0.8) == pytest.approx(0.0)
    assert path.position(0.7) == pytest.approx([0.25])


def test_the_eye_stays_in_front_of_the_head_and_names_bodies():
    from lerobot_robot_humanoid_sim.camera import Eye  # noqa: PLC0415

    from humanoid_sim.errors import InputError  # noqa: PLC0415
    from humanoid_sim.simulation.model import build_model  # noqa: PLC0415

    model = build_model(load_robot("lite"))
    eye = Eye(model)
    eye.look(model.qpos0)
    assert eye.camera.elevation == pytest.approx(-45.0, abs=0.1)
    assert eye.camera.azimuth == pytest.approx(0.0, abs=0.1)
    headless = mujoco.MjModel.from_xml_string("<mujoco><worldbody><body name='arm'/></worldbody></mujoco>")
    with pytest.raises(InputError, match=r"camera: no body is called head or torso or chest; it has: arm"):
        Eye(headless)


def test_the_options_are_in_the_plugins_documentation():
    from dataclasses import fields  # noqa: PLC0415

    from lerobot_robot_humanoid_sim import HumanoidSimCameraConfig, HumanoidSimConfig  # noqa: PLC0415
    from lerobot_teleoperator_humanoid_sim import HumanoidSimTeleoperatorConfig  # noqa: PLC0415

    page = (Path(__file__).parent.parent.parent / "docs" / "lerobot.md").read_text()
    configs = HumanoidSimConfig, HumanoidSimCameraConfig, HumanoidSimTeleoperatorConfig
    names = {field.name for config in configs for field in fields(config)} - {"id", "calibration_dir"}
    assert [name for name in sorted(names) if f"`{name}`" not in page] == []
