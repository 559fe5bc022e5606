"""Traces: the trainer's run in a file, with what it may leave out, and what is refused."""

import numpy as np
import pytest
import trainer

from humanoid_sim.controllers.contract import HeightScan, Term
from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import Checkpoint, load_checkpoint
from humanoid_sim.policy.golden import trainer_samples
from humanoid_sim.policy.traces import read_trace
from humanoid_sim.policy_tools.stamp import body_reader
from humanoid_sim.robots.description import load_robot


@pytest.fixture
def checkpoint(tmp_path):
    return load_checkpoint(trainer.save_checkpoint(tmp_path / "walker.onnx"))


def fits(checkpoint, path):
    trainer_samples(checkpoint, read_trace(path, checkpoint.contract))


def test_reads_states_without_qpos(checkpoint, tmp_path):
    run = trainer.Run()
    fits(
        checkpoint,
        trainer.save_trace(
            tmp_path / "t.npz",
            run,
            qpos=None,
            qvel=None,
            joint_names=np.array(trainer.ROBOT_JOINTS),
            joint_position=run.qpos[:, 7:],
            joint_velocity=run.qvel[:, 6:],
            imu_quaternion=run.qpos[:, 3:7],
            imu_angular_velocity=run.qvel[:, 3:6],
        ),
    )


def test_joints_that_the_policy_lacks_are_left_out(checkpoint, tmp_path):
    run = trainer.Run()
    trace = read_trace(
        trainer.save_trace(
            tmp_path / "t.npz",
            run,
            qpos=np.insert(run.qpos, 9, 0.4, axis=1),
            qvel=np.insert(run.qvel, 8, 0.1, axis=1),
            target=np.insert(run.target, 2, 0.0, axis=1),
            joint_names=np.array(["root", *trainer.ROBOT_JOINTS[:2], "waist", *trainer.ROBOT_JOINTS[2:]]),
        ),
        checkpoint.contract,
    )
    assert trace.joint_names == trainer.ROBOT_JOINTS
    assert trainer_samples(checkpoint, trace).arrays["target"].shape == (8, 4)


def test_a_run_that_does_not_start_at_activation_gives_its_memory(checkpoint, tmp_path):
    run, start = trainer.Run(), 7
    arrays = {name: table[start:] for name, table in run.arrays().items() if len(table) == run.steps}
    late = trainer.save_trace(tmp_path / "late.npz", run, **arrays)
    with pytest.raises(InputError, match=r"joint_pos_rel|last_action|sin_phase"):
        fits(checkpoint, late)
    before = np.arange(start, run.steps)[:, None] - np.arange(trainer.HISTORY, 0, -1)
    newest = 9 + 4 * (trainer.HISTORY - 1)
    memory = {
        "last_action": run.action[start - 1 : -1],
        "frame": np.zeros(run.steps - start),
        "walked": 2.0 * np.pi * 0.02 / 0.8 * np.arange(start, run.steps),
        "history": np.concatenate([run.obs[:, :9], run.obs[:, newest:]], axis=1)[before],
    }
    fits(checkpoint, trainer.save_trace(tmp_path / "whole.npz", run, **arrays, **memory))


def test_both_versions_of_mujoco_are_named_where_something_differs(checkpoint, tmp_path):
    run = trainer.Run(5)
    path = trainer.save_trace(tmp_path / "t.npz", run, mujoco_version=np.array("3.1.0"), action=run.action + 0.1)
    with pytest.raises(InputError, match=r"last_action\[0\].*recorded with MuJoCo 3\.1\.0; here it is 3\."):
        fits(checkpoint, path)


def test_a_robots_model_tells_imu_and_anchor(tmp_path):
    mjcf = tmp_path / "walker.xml"
    mjcf.write_text(trainer.MJCF, encoding="utf-8")
    run = trainer.Run(3)
    path = trainer.save_trace(tmp_path / "t.npz", run)
    robot = load_robot(str(mjcf))
    trace = read_trace(path, trainer.contract(), body_reader(robot, "left_thigh"))
    state = trace.state(1)
    np.testing.assert_allclose(state.imu_angular_velocity, run.qvel[1, 3:6], atol=1e-12)
    np.testing.assert_allclose(state.extern["base_linear_velocity"].value, run.qvel[1, :3], atol=1e-12)
    pose = state.extern["anchor_pose"].value
    assert pose.shape == (7,)
    assert np.linalg.norm(pose[:3] - run.qpos[1, :3]) == pytest.approx(0.1)
    with pytest.raises(InputError, match="left_shin"):
        body_reader(robot, "left_shin")


BROKEN = {
    "no action": (lambda _: {"action": None}, "action is missing"),
    "no observation": (lambda _: {"obs": None}, "observation is missing"),
    "no names": (lambda _: {"joint_names": None}, "joint_names is missing"),
    "a name twice": (
        lambda _: {"joint_names": np.array(["root", "a", "a", "b", "c"])},
        "joint_names names a joint twice",
    ),
    "a joint missing": (
        lambda _: {"joint_names": np.array(["root", "left_hip", "x", "right_hip", "right_knee"])},
        "joint_names lacks left_knee",
    ),
    "no state": (lambda _: {"qpos": None}, "joint_position is missing"),
    "no qvel": (lambda _: {"qvel": None}, "qvel is missing"),
    "short qpos": (lambda run: {"qpos": run.qpos[:5]}, "qpos has shape"),
    "narrow action": (lambda run: {"action": run.action[:, :2]}, "action has shape"),
    "flat observation": (lambda run: {"obs": run.obs.ravel()}, "observation has shape"),
    "text": (lambda run: {"obs": run.obs.astype(str)}, "observation has type"),
    "not finite": (lambda run: {"obs": np.where(run.obs > 0.9, np.nan, run.obs)}, "observation is not finite"),
    "no command": (lambda _: {"cmd": None}, "velocity_command is missing"),
    "wide command": (lambda _: {"cmd": np.zeros(4)}, "velocity_command has shape"),
    "frame": (lambda _: {"frame": np.zeros(2)}, "frame has shape"),
}


@pytest.mark.parametrize("what", BROKEN)
def test_broken_traces_are_one_line(tmp_path, what):
    change, expected = BROKEN[what]
    run = trainer.Run(10)
    path = trainer.save_trace(tmp_path / "t.npz", run, **change(run))
    with pytest.raises(InputError) as refusal:
        read_trace(path, trainer.contract())
    assert str(refusal.value).startswith(f"{path}: {expected}")
    assert "\n" not in str(refusal.value)


def test_files_that_are_no_trace(tmp_path):
    np.savez_compressed(tmp_path / "cut.npz", action=np.arange(1000.0))
    (tmp_path / "cut.npz").write_bytes((tmp_path / "cut.npz").read_bytes()[:60])
    (tmp_path / "text.npz").write_bytes(b"hello")
    np.savez(tmp_path / "objects.npz", action=np.array([{"a": 1}], dtype=object))
    for name in ("missing.npz", "cut.npz", "text.npz", "objects.npz"):
        with pytest.raises(InputError, match=rf"^{tmp_path / name}: "):
            read_trace(tmp_path / name, trainer.contract())


def test_terms_that_the_trace_says_nothing_about(tmp_path):
    def wants(*observation):
        return trainer.contract(observation=observation)

    path = trainer.save_trace(tmp_path / "t.npz", trainer.Run(3))
    for term, array in {
        "imu_linear_acceleration": "imu_linear_acceleration",
        "motion_anchor_pos_b": "anchor_pose",
        "key_pressed": "key_pressed",
    }.items():
        with pytest.raises(InputError, match=f"{array} is missing.*{term}"):
            read_trace(path, wants("joint_pos", term))


SCAN = Term("height_scan", scan=HeightScan("left_thigh", (0.2, 0.0), 0.2), scale=0.5, clip=(0.0, 3.0))
SEEING = Checkpoint(
    trainer.contract(observation=[*trainer.terms(), SCAN]),
    lambda observation, _: observation[: trainer.WIDTH] @ trainer.network(),
    "seeing.onnx",
)
SLOPE = '<worldbody><geom type="plane" size="0 0 1" euler="0 -0.4636476090008061 0"/>'
"""Rises by half a metre per metre along x."""


def scanned(run):
    """The scan of a run above the slope, by hand: shape (F, 2), m."""
    w, x, y, z = run.qpos[:, 3:7].T
    hip = np.stack([2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)], axis=1)
    middle = run.qpos[:, :3] + 0.1 * hip  # of the thigh, whose hip has turned it as well
    pitch = run.qpos[:, 7 + trainer.ROBOT_JOINTS.index("left_hip")]
    ahead = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z)], axis=1) * np.cos(pitch)[:, None]
    ahead -= np.stack([2 * (x * z + w * y), 2 * (y * z - w * x)], axis=1) * np.sin(pitch)[:, None]
    yaw = np.arctan2(ahead[:, 1], ahead[:, 0])
    return np.stack([middle[:, 2] - 0.5 * (middle[:, 0] + side * np.cos(yaw)) for side in (-0.1, 0.1)], axis=1)


def seen(run, heights):
    return np.concatenate([run.obs, 0.5 * np.clip(heights, 0.0, 3.0)], axis=1).astype(np.float32)


def test_a_height_scan_is_in_the_trace_or_follows_from_the_ground_in_the_robots_model(tmp_path):
    run = trainer.Run()
    heights = scanned(run)
    with_array = trainer.save_trace(tmp_path / "a.npz", run, obs=seen(run, heights), height_scan=heights)
    fits(SEEING, with_array)
    mjcf = tmp_path / "scene.xml"
    mjcf.write_text(trainer.MJCF.replace("<worldbody>", SLOPE), encoding="utf-8")
    bodies = body_reader(load_robot(str(mjcf)), "", (), SEEING.contract.height_scan)
    without = trainer.save_trace(tmp_path / "b.npz", run, obs=seen(run, heights))
    by_rays = read_trace(without, SEEING.contract, bodies)
    np.testing.assert_allclose(by_rays.arrays["extern/height_scan"], heights, rtol=0.0, atol=1e-9)
    trainer_samples(SEEING, by_rays)
    with pytest.raises(
        InputError, match="height_scan is missing, expected it, as the policy observes height_scan, or "
    ):
        read_trace(without, SEEING.contract)
    with pytest.raises(InputError, match=r"height_scan has shape \(30, 3\), expected \(30, 2\), finite numbers"):
        read_trace(trainer.save_trace(tmp_path / "c.npz", run, height_scan=np.zeros((30, 3))), SEEING.contract)
