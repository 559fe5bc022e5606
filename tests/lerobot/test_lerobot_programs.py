"""LeRobot's own programs, unchanged, on a running session: the plugins of `plugins/`."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import numpy as np
import pytest

from humanoid_sim.client import Feed, Intake, SessionError, find_session
from humanoid_sim.messages import Mode
from humanoid_sim.recording.reader import open_recording
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.kinematics import ForwardKinematics

pytestmark = [pytest.mark.lerobot, pytest.mark.filterwarnings("ignore"), pytest.mark.timeout(400)]

FPS = 20
ROBOT = "--robot.type=humanoid_sim"
TO_REMOTE = "damp; load_b; wait; start_remote; hold 900"


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
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)


def lerobot(name, *options, keys=""):
    """Run a program of LeRobot's to its end; gives its status and what it printed."""
    with start(name, *options, "--play_sounds=false") as process:
        try:
            printed = process.communicate(keys.encode(), timeout=300)[0].decode(errors="replace")
        finally:
            process.kill()
    return process.returncode, printed


def replay(root):
    return lerobot("replay", ROBOT, *dataset_options(root, episode=0))


def dataset_options(root, **others):
    given = {"repo_id": f"local/{root.name}", "root": root, **others}
    return [f"--dataset.{name}={value}" for name, value in given.items()]


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
    """A dataset of two episodes; in the first keys lead the hands up and forward, the right one to the left."""
    folder = tmp_path_factory.mktemp("recorded")
    options = dataset_options(
        folder / "reach", single_task="Raise the hands.", num_episodes=2, episode_time_s=2.5, reset_time_s=0.5,
        fps=FPS, push_to_hub="false",
    )  # fmt: skip
    with session(folder / "run.mcap"):
        keys = 10 * "r" + 10 * "w" + "2" + 10 * "a"
        status, printed = lerobot("record", ROBOT, "--teleop.type=humanoid_sim", *options, keys=keys)
    assert status == 0, printed[-3000:]
    return folder


def frames(root, episode):
    """Measured and commanded joints of an episode."""
    import pandas as pd  # noqa: PLC0415

    table = pd.concat([pd.read_parquet(path) for path in sorted((root / "data").rglob("*.parquet"))])
    table = table[table.episode_index == episode]
    return (np.stack(table[name].to_list()).astype(float) for name in ("observation.state", "action"))


def distance_at_the_end(recording, root):
    """Distance, rad, of what was commanded to the nearest of an episode's last actions: some fall between ticks."""
    _, action = frames(root, 0)
    ticks = [tick for tick in open_recording(recording).ticks() if tick.input.remote is not None]
    commanded = np.stack([tick.output.command.position for tick in ticks])
    return np.abs(commanded[:, None] - action[-5:]).max(axis=-1).min()


def test_keys_lead_the_hands(recorded):
    from lerobot.datasets.lerobot_dataset import LeRobotDataset  # noqa: PLC0415

    dataset = LeRobotDataset("local/reach", root=recorded / "reach")
    assert (dataset.num_episodes, dataset.fps, dataset.meta.robot_type) == (2, FPS, "humanoid_sim")
    names = [f"{joint}.pos" for joint in load_robot("lite").joint_names]
    assert dataset.features["action"]["names"] == dataset.features["observation.state"]["names"] == names
    state, action = frames(recorded / "reach", 0)
    assert np.abs(np.diff(action, axis=0)).max() < 2.0 * 0.2, "rad: the joints' speed is bounded"
    path = ForwardKinematics(load_robot("lite"))(state)[0]
    moved = path[-1] - path[0]
    assert moved[:, 2].min() > 0.03
    assert moved[:, 0].min() > 0.015
    assert moved[:, 1].sum() > 0.01, "the second hand alone goes to the left"


def test_a_replay_brings_the_joints_where_they_were(recorded):
    replayed = recorded / "replayed.mcap"
    with session(replayed) as feed:
        status, printed = replay(recorded / "reach")
        assert status == 0, printed[-3000:]
        wait_for(lambda: not is_commanded(feed), 5.0)
        assert mode_of(feed) is Mode.REMOTE
    assert distance_at_the_end(replayed, recorded / "reach") < 0.02


@pytest.mark.parametrize("fate", [signal.SIGKILL, signal.SIGSTOP])
def test_a_client_that_is_lost_leaves_the_passive_hold(fate, tmp_path):
    teleoperate = ("teleoperate", ROBOT, "--teleop.type=humanoid_sim", "--fps=30")
    with session(tmp_path / "run.mcap") as feed, start(*teleoperate) as process:
        try:
            wait_for(lambda: is_commanded(feed))
            os.kill(process.pid, fate)
            wait_for(lambda: not is_commanded(feed), 5.0)
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
            seen = robot.get_observation()
            assert list(seen) == list(robot.observation_features)
            assert len(seen) == 3 * 14 + 10
            action = {name: seen[name] for name in robot.action_features}
            assert robot.send_action(action) == pytest.approx(action, abs=0.1)
            with pytest.raises(ValueError, match="expected finite numbers"):
                robot.send_action(action | {"left_elbow_pitch.pos": np.nan})
            intake.ask("damp")
            with pytest.raises(DeviceNotConnectedError, match="is in DAMPING, expected REMOTE"):
                wait_for(lambda: robot.send_action(action) is None)  # until that tick has come
        robot.disconnect()
