"""`prepare` from its options to its files."""

import json

import numpy as np
import pytest
from motion_samples import BODIES, joint_frames, joint_path, lite, state_of, write_npz

from humanoid_sim.assets import asset_path
from humanoid_sim.cli import run_program
from humanoid_sim.play import main as play
from humanoid_sim.policy.motion import read_motion
from humanoid_sim.prepare import main
from humanoid_sim.prepare.skeleton import Skeleton

POLICY = asset_path("policies", "lite_tracking.onnx")


def prepare(tmp_path, motion, *options):
    given = [] if motion is None else ["--motion", str(motion)]
    return run_program(main, ["--policy", str(POLICY), "--output", str(tmp_path / "out"), *given, *options])


def refusal(capsys, tmp_path, motion, *options):
    """The one line of a refused run, which leaves nothing behind."""
    assert prepare(tmp_path, motion, *options) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()
    return error


def assert_made(tmp_path, accepted=2e-6):
    """The motion file holds what the joints of the sample do."""
    frames = read_motion(tmp_path / "out" / "dance.mcap").frames
    np.testing.assert_allclose(frames, joint_frames(lite(), joint_path()), atol=accepted)


def test_a_motion_becomes_a_file_that_plays(tmp_path, capsys):
    assert prepare(tmp_path, write_npz(tmp_path / "dance.npz")) == 0
    out = tmp_path / "out"
    assert sorted(path.name for path in out.iterdir()) == ["dance.json", "dance.mcap", "lite_tracking.onnx"]
    motion = read_motion(out / "dance.mcap")
    assert (motion.body_names, motion.policy_dt, motion.robot, motion.layout) == (BODIES, 0.02, "lite", "bodies_b")
    assert_made(tmp_path)
    assert (out / "lite_tracking.onnx").read_bytes() == POLICY.read_bytes()
    printed = capsys.readouterr().out
    assert "bodies against forward kinematics, tolerance 10 mm, 2°" in printed
    assert "right_hand" in printed
    summary = tmp_path / "summary.json"
    options = ["--record", "none", "--html", "none", "--viewer", "none", "--summary", str(summary)]
    options += ["--policy-seconds", "0.5"]
    assert play(["--policy", str(out / "lite_tracking.onnx"), "--motion", str(out / "dance.mcap"), *options]) == 0
    assert summary.is_file()


def test_the_report(tmp_path):
    assert prepare(tmp_path, write_npz(tmp_path / "dance.npz"), "--name", "first") == 0
    report = json.loads((tmp_path / "out" / "first.json").read_text())
    assert report["verified"] is True
    assert report["method"] == "forward kinematics"
    assert report["source"] == str(tmp_path / "dance.npz")
    assert [report[key] for key in ("source_fps", "source_frames", "frames")] == [50.0, 40, 40]
    assert report["resampled"] is False
    assert report["tolerance"] == {"position": 0.01, "angle": pytest.approx(np.radians(2.0))}
    assert [body["name"] for body in report["bodies"]] == list(Skeleton(lite()).bodies)
    assert max(body["position_max"] for body in report["bodies"]) < 1e-5
    assert report["conventions"]["joints_said_by"] == "assumed: contract"


SAMPLE = state_of(joint_path())
LEAD = np.roll(np.arange(14), 1)
SKELETON = Skeleton(lite())
JOINTS = [SKELETON.joints.index(name) for name in SKELETON.joint_orders["breadth_first"]]
BODIES_BY_LEVEL = [SKELETON.bodies.index(name) for name in SKELETON.body_orders["breadth_first"]]
BREADTH_JOINTS = {name: SAMPLE[name][:, JOINTS] for name in ("joint_pos", "joint_vel")}
BREADTH_BODIES = {name: SAMPLE[name][:, BODIES_BY_LEVEL] for name in ("body_pos_w", "body_quat_w")}

ANGLES, SPEEDS, POINTS, TURNS = (SAMPLE[name] for name in ("joint_pos", "joint_vel", "body_pos_w", "body_quat_w"))
IN_DEGREES = {"joint_pos": np.degrees(ANGLES), "joint_vel": np.degrees(SPEEDS)}
HAND_UP = POINTS + np.eye(18)[7][None, :, None] * [0.0, 0.0, 0.02]
OFF = "expected this robot's motion, as --joint-order, --body-order, --quaternions and --angle-unit say"
WRONG = {
    "joints": ({"joint_pos": ANGLES[:, LEAD], "joint_vel": SPEEDS[:, LEAD]}, OFF),
    "breadth-first joints": (BREADTH_JOINTS, OFF),
    "breadth-first bodies": (BREADTH_BODIES, OFF),
    "quaternions": ({"body_quat_w": np.roll(TURNS, -1, -1)}, OFF),
    "degrees": (IN_DEGREES, OFF),
    "degrees and radians": ({"joint_pos": np.degrees(ANGLES)}, "joint velocities are 0.017 times the derivatives"),
    "centimetres": ({"body_pos_w": 100.0 * POINTS}, OFF),
    "a body": (
        {"body_pos_w": HAND_UP},
        "body 'left_hand' is up to 2.0 cm and 0.0° from where the robot's forward kinematics puts it",
    ),
    "rate": (
        {"fps": np.array([30])},
        "joint velocities are 1.7 times the derivatives of joint positions at fps 30",
    ),
    "velocities": ({"joint_vel": SPEEDS[:, ::-1]}, "or let --velocities positions compute them"),
    "not a number": ({"body_pos_w": np.full((40, 18, 3), np.nan)}, "body_position is nan at frame 0"),
    "frames": ({"body_quat_w": TURNS[:-1]}, "body_quaternion has 39 frames, joint_position has 40"),
    "no key": ({"joint_vel": None}, "has no joint_vel"),
    "joint count": (
        {"joint_pos": ANGLES[:, :13], "joint_vel": SPEEDS[:, :13]},
        "has 13 joints per frame, and the order 'contract' has 14",
    ),
    "body count": (
        {"body_pos_w": POINTS[:, :9], "body_quat_w": TURNS[:, :9]},
        "has 9 bodies per frame; the contract has 4, the robot 18; say which they are with --body-order",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_motion_is_refused(tmp_path, capsys, name):
    changes, reason = WRONG[name]
    assert reason in refusal(capsys, tmp_path, write_npz(tmp_path / "dance.npz", **changes))


def test_what_the_options_say_makes_it_fit(tmp_path):
    turned = {"body_quat_w": np.roll(BREADTH_BODIES["body_quat_w"], -1, -1)}
    path = write_npz(tmp_path / "dance.npz", **BREADTH_JOINTS | BREADTH_BODIES | turned)
    options = ("--joint-order", "breadth_first", "--body-order", "breadth_first", "--quaternions", "xyzw")
    assert prepare(tmp_path, path, *options) == 0
    assert_made(tmp_path)


def test_any_order_can_be_named(tmp_path):
    path = write_npz(
        tmp_path / "dance.npz", joint_pos=SAMPLE["joint_pos"][:, LEAD], joint_vel=SAMPLE["joint_vel"][:, LEAD]
    )
    order = ",".join(lite().joint_names[i] for i in LEAD)
    assert prepare(tmp_path, path, "--joint-order", order) == 0
    assert_made(tmp_path)


def test_degrees_can_be_read(tmp_path):
    assert prepare(tmp_path, write_npz(tmp_path / "dance.npz", **IN_DEGREES), "--angle-unit", "deg") == 0
    assert_made(tmp_path, 1e-5)
    assert json.loads((tmp_path / "out" / "dance.json").read_text())["conventions"]["angle_unit"] == "deg"


def test_a_wider_tolerance_lets_a_small_error_through(tmp_path, capsys):
    path = write_npz(tmp_path / "dance.npz", **WRONG["a body"][0])
    assert prepare(tmp_path, path, "--tolerance", "0.025") == 0
    assert "left_hand" in capsys.readouterr().out


def test_velocities_can_be_computed_from_the_positions(tmp_path, capsys):
    path = write_npz(tmp_path / "dance.npz", joint_vel=0.0 * SAMPLE["joint_vel"])
    assert prepare(tmp_path, path, "--velocities", "positions") == 0
    assert "computed from the positions" in capsys.readouterr().out
    assert_made(tmp_path)


def test_another_rate_is_resampled_only_on_request(tmp_path, capsys):
    state = state_of(joint_path()[::2], fps=25.0)
    path = tmp_path / "dance.npz"
    np.savez(path, **state)
    assert "25 frames per second, the policy takes 50 steps; add --resample" in refusal(capsys, tmp_path, path)
    assert prepare(tmp_path, path, "--resample") == 0
    motion = read_motion(tmp_path / "out" / "dance.mcap")
    assert (len(motion.frames), motion.policy_dt) == (39, 0.02)
    np.testing.assert_allclose(motion.frames[::2], joint_frames(lite(), joint_path()[::2]), atol=2e-6)
    np.testing.assert_allclose(motion.frames, joint_frames(lite(), joint_path()[:39]), atol=0.01)


def write_csv(path, header, q):
    names = ",".join(lite().joint_names) + "\n" if header else ""
    path.write_text(names + "".join(",".join(f"{value:.7f}" for value in row) + "\n" for row in q))
    return path


@pytest.mark.parametrize("header", [True, False])
def test_a_csv_of_joints(tmp_path, capsys, header):
    path = write_csv(tmp_path / "dance.csv", header, joint_path())
    assert prepare(tmp_path, path, "--fps", "50") == 0
    assert "the order of its joints could not be verified" in " ".join(capsys.readouterr().out.split())
    assert json.loads((tmp_path / "out" / "dance.json").read_text())["verified"] is False
    assert_made(tmp_path)


def test_a_csv_whose_joints_are_beyond_their_limits(tmp_path, capsys):
    order = [lite().joint_names.index(name) for name in Skeleton(lite()).joint_orders["breadth_first"]]
    path = write_csv(tmp_path / "dance.csv", False, joint_path()[:, order])
    assert "beyond its limits" in refusal(capsys, tmp_path, path, "--fps", "50")


def test_a_csv_with_its_quaternion_in_the_other_order(tmp_path, capsys):
    base = np.tile([0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0], (40, 1))
    path = write_csv(tmp_path / "dance.csv", False, np.concatenate([base, joint_path()], axis=1))
    error = refusal(capsys, tmp_path, path, "--fps", "50")
    assert "the base is upside down most of the time; it would be upright with --quaternions wxyz" in error
    assert prepare(tmp_path, path, "--fps", "50", "--quaternions", "wxyz") == 0


def test_a_csv_in_degrees(tmp_path, capsys):
    path = write_csv(tmp_path / "dance.csv", True, np.degrees(joint_path()))
    assert "beyond its limits" in refusal(capsys, tmp_path, path, "--fps", "50")
    assert prepare(tmp_path, path, "--fps", "50", "--angle-unit", "deg") == 0
    assert_made(tmp_path)


def test_nothing_is_replaced_unless_asked(tmp_path, capsys):
    path = write_npz(tmp_path / "dance.npz")
    assert prepare(tmp_path, path) == 0
    before = (tmp_path / "out" / "dance.mcap").read_bytes()
    capsys.readouterr()
    assert prepare(tmp_path, path) == 2
    assert "exists; choose another --name, or add --overwrite" in capsys.readouterr().err
    assert prepare(tmp_path, path, "--overwrite") == 0
    assert (tmp_path / "out" / "dance.mcap").read_bytes() == before
    assert prepare(tmp_path, path, "--name", "again") == 0


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--wandb-run-path", "a/b/c"], "--policy and --wandb-run-path: both are given"),
        (["--wandb-file", "x.onnx"], "--wandb-file: needs --wandb-run-path"),
        (["--dataset", "a/b", "--motion", "x.npz"], "--motion and --dataset: both are given"),
        (["--motion", "gone.npz"], "--motion: 'gone.npz' does not exist"),
        (["--tolerance", "0"], "--tolerance: is 0.0, expected a finite number > 0"),
        (["--name", "a/b"], "--name: is 'a/b'"),
        (["--features", "joints=x"], "--features: is 'joints=x', expected ROLE=FEATURE"),
        (["--robot", "nobody"], "unknown robot 'nobody'"),
    ],
)
def test_options_that_make_no_sense(tmp_path, capsys, options, reason):
    assert reason in refusal(capsys, tmp_path, None, *options)


def test_a_file_that_is_no_motion(tmp_path, capsys):
    path = tmp_path / "dance.bvh"
    path.write_text("HIERARCHY")
    assert "is neither an .npz or .csv file nor a folder" in refusal(capsys, tmp_path, path)


def test_a_folder_that_is_no_dataset(tmp_path, capsys):
    folder = tmp_path / "dances"
    (folder / "meta").mkdir(parents=True)
    assert "is not a LeRobot dataset: it has no meta/info.json" in refusal(capsys, tmp_path, folder)
    (folder / "meta" / "info.json").write_text('{"codebase_version": "v2.1"}')
    assert "is a LeRobot dataset of format v2.1, expected v3.0" in refusal(capsys, tmp_path, folder)
    (folder / "meta" / "info.json").write_text("{")
    assert "is not JSON" in refusal(capsys, tmp_path, folder)


def test_a_policy_that_follows_no_motion(tmp_path, capsys):
    path = walker(tmp_path / "walk.onnx")
    arguments = ["--policy", str(path), "--output", str(tmp_path / "out")]
    assert run_program(main, arguments) == 0
    assert "follows no motion; nothing else to prepare" in capsys.readouterr().out
    assert [file.name for file in (tmp_path / "out").iterdir()] == ["walk.onnx"]
    assert run_program(main, [*arguments, "--motion", "x.npz"]) == 2
    assert f"--motion: is given, but {path} follows no motion" in capsys.readouterr().err


def walker(path):
    """The sample policy, called a locomotion policy that sees no motion."""
    import onnx  # noqa: PLC0415
    from models import linear_model, saved  # noqa: PLC0415

    joints = lite().joint_names
    entries = onnx.load(POLICY, load_external_data=False).metadata_props
    # A stamp would contradict what is changed.
    metadata = {entry.key: entry.value for entry in entries if not entry.key.startswith("humanoid_sim")}
    metadata |= {"task_type": "locomotion", "observation_names": "joint_pos", "body_names": ""}
    return saved(path, linear_model(metadata, matrix=np.zeros((len(joints), len(joints)))))
