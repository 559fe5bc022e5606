"""`prepare` from its options to its file: each kind of source, what has to be said of it, and what is refused."""

import mido
import numpy as np
import pytest
from models import contract_of, linear_model, saved
from motion_samples import BODIES, FRAMES, POLICY, joint_frames, joint_path, lite, prepare, refusal, state_of, write_npz
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from humanoid_sim.cli import run_program
from humanoid_sim.controllers.rotation import multiply, quaternion_from_matrix, rotate
from humanoid_sim.policy.checkpoint import read_contract
from humanoid_sim.policy.motion import read_motion
from humanoid_sim.policy.readers.own import STAMP_KEY, encode, write_metadata
from humanoid_sim.prepare import main
from humanoid_sim.prepare.convert import Skeleton

SKELETON = Skeleton(lite(), read_contract(POLICY))
SAMPLE = state_of(joint_path(), SKELETON.bodies)
ANGLES, SPEEDS, POINTS, TURNS = (SAMPLE[name] for name in ("joint_pos", "joint_vel", "body_pos_w", "body_quat_w"))
LEVELS = [SKELETON.joints.index(name) for name in SKELETON.joint_orders["breadth_first"]]
BODY_LEVELS = [SKELETON.bodies.index(name) for name in SKELETON.body_orders["breadth_first"]]
ISAACS = {
    "joint_pos": ANGLES[:, LEVELS],
    "joint_vel": SPEEDS[:, LEVELS],
    "body_pos_w": POINTS[:, BODY_LEVELS],
    "body_quat_w": TURNS[:, BODY_LEVELS],
}
LEAD = np.roll(np.arange(14), 1)


def made(tmp_path, name="dance"):
    return read_motion(tmp_path / "out" / f"{name}.mcap")


def assert_sample(tmp_path, tolerance=2e-6):
    """The motion file holds what the joints of the sample do."""
    np.testing.assert_allclose(made(tmp_path).frames, joint_frames(lite(), joint_path()), atol=tolerance)


def npz(tmp_path, **changes):
    return write_npz(tmp_path / "dance.npz", SAMPLE, **changes)


def csv(tmp_path, rows, *names):
    lines = [",".join(names), *(",".join(f"{value:.7f}" for value in row) for row in rows)]
    path = tmp_path / "dance.csv"
    path.write_text("\n".join(line for line in lines if line) + "\n", encoding="utf-8")
    return path


def test_an_npz_becomes_a_motion_file(tmp_path, capsys):
    assert prepare(tmp_path, npz(tmp_path)) == 0
    motion = made(tmp_path)
    assert (motion.body_names, motion.policy_dt, motion.robot, motion.layout) == (BODIES, 0.02, "lite", "bodies_b")
    assert_sample(tmp_path)
    printed = capsys.readouterr().out
    assert "18 bodies fit" in printed
    assert "assumed, and confirmed by the bodies: --joint-order contract" in printed
    assert "exists; choose another --name, or add --overwrite" in refusal(capsys, tmp_path, npz(tmp_path))
    assert prepare(tmp_path, npz(tmp_path), "--overwrite") == 0


LED = {"joint_pos": ANGLES[:, LEAD], "joint_vel": SPEEDS[:, LEAD]}
ISAACS_OPTIONS = ["--joint-order", "breadth_first", "--body-order", "breadth_first", "--quaternions", "xyzw"]


@pytest.mark.parametrize(
    ("changes", "options"),
    [
        (ISAACS | {"body_quat_w": np.roll(TURNS[:, BODY_LEVELS], -1, -1)}, ISAACS_OPTIONS),
        (LED, ["--joint-order", ",".join(lite().joint_names[i] for i in LEAD)]),
        ({"joint_pos": ANGLES[:, LEAD], "joint_names": np.array(lite().joint_names, dtype=bytes)[LEAD]}, []),
        ({"joint_pos": np.degrees(ANGLES), "joint_vel": np.degrees(SPEEDS)}, ["--degrees"]),
        (
            {"body_pos_w": POINTS[:, [7, 1]], "body_quat_w": TURNS[:, [7, 1]]},
            ["--body-order", f"{SKELETON.bodies[7]},{SKELETON.bodies[1]}"],
        ),
    ],
    ids=["Isaac's orders", "joints by name", "names in the file", "degrees", "two bodies"],
)
def test_what_the_file_does_not_say_the_options_do(tmp_path, changes, options):
    assert prepare(tmp_path, npz(tmp_path, **changes), *options) == 0
    assert_sample(tmp_path, 1e-5)


LAID = quaternion_from_matrix(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]))
Y_UP = {"body_pos_w": rotate(LAID, POINTS), "body_quat_w": multiply(LAID, TURNS)}
JUMP = np.where(np.arange(FRAMES)[:, None] == 20, ANGLES + 1.0, ANGLES)


@pytest.mark.parametrize(
    ("changes", "note"),
    [
        (Y_UP, "its base lies most of the time, as if y were up"),
        ({"joint_vel": 0.6 * SPEEDS}, "its joint velocities are 0.60 times its positions' change; is its rate right?"),
        ({"joint_pos": JUMP, "joint_vel": np.gradient(JUMP, 0.02, axis=0)}, "rad/s after frame 19"),
    ],
)
def test_a_motion_that_fits_but_cannot_be_meant_so_gets_a_note(tmp_path, capsys, changes, note):
    state = state_of(changes.get("joint_pos", ANGLES).astype(np.float64), SKELETON.bodies)
    assert prepare(tmp_path, write_npz(tmp_path / "dance.npz", state, **changes)) == 0
    assert note in capsys.readouterr().out


LIFTED = POINTS + np.eye(18)[7][None, :, None] * [0.0, 0.0, 0.02]


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"joint_pos": ANGLES[:, LEAD]}, "bodies are off"),
        ({"body_quat_w": np.roll(TURNS, -1, -1)}, "bodies are off"),
        ({"body_pos_w": LIFTED}, "body 'left_hand' is 20.0 mm and 0.0°"),
        ({"body_pos_w": np.full((FRAMES, 18, 3), np.nan)}, "bodies is not finite in frame 0, at [0, 0]"),
        ({"joint_vel": None}, "has no joint_vel"),
        ({"joint_vel": SPEEDS[1:]}, "joint_vel (39, 14), "),
        ({"fps": np.array([0.0])}, "fps is 0"),
        ({"joint_pos": ANGLES[:, :13], "joint_vel": SPEEDS[:, :13]}, "--joint-order: contract has 14 names"),
        ({"fps": np.zeros(0)}, "expected (F, n), (F, n)"),
        ({"joint_pos": ANGLES[None], "joint_vel": SPEEDS[None]}, "has joint_pos (1, 40, 14)"),
        ({"joint_names": np.array([f"joint_{i}" for i in range(14)])}, "unknown joint 'joint_0'"),
        ({"joint_names": np.array([lite().joint_names[0]] * 14)}, f"lacks {lite().joint_names[1]}, "),
    ],
)
def test_an_npz_that_is_not_this_robots_is_refused(tmp_path, capsys, changes, reason):
    assert reason in refusal(capsys, tmp_path, npz(tmp_path, **changes))
    assert not (tmp_path / "out").exists()


def test_another_rate_is_resampled_only_on_request(tmp_path, capsys):
    path = write_npz(tmp_path / "dance.npz", state_of(joint_path()[::2], SKELETON.bodies, fps=25.0))
    assert "has 25 frames per second, the policy takes 50" in refusal(capsys, tmp_path, path)
    assert prepare(tmp_path, path, "--resample") == 0
    motion = made(tmp_path)
    assert (len(motion.frames), motion.policy_dt) == (39, 0.02)
    np.testing.assert_allclose(motion.frames[::2], joint_frames(lite(), joint_path()[::2]), atol=2e-6)
    np.testing.assert_allclose(motion.frames, joint_frames(lite(), joint_path()[:39]), atol=0.01)


TIMES = np.arange(FRAMES)[:, None] / 50.0
BASE = np.tile([1.0, 2.0, 0.5, np.cos(0.35), 0.0, 0.0, np.sin(0.35)], (FRAMES, 1))
BASE_NAMES = ("base_x", "base_y", "base_z", "base_qw", "base_qx", "base_qy", "base_qz")
XYZW = BASE[:, [0, 1, 2, 4, 5, 6, 3]]
ROWS = joint_path()
NAMED = ["--fps", "50"]
BARE = [*NAMED, "--joint-order", "robot"]


@pytest.mark.parametrize(
    ("rows", "names", "options"),
    [
        ([ROWS], lite().joint_names, NAMED),
        ([TIMES, ROWS[:, ::-1]], ("time", *(f"{name}.pos" for name in lite().joint_names[::-1])), []),
        ([BASE, ROWS], (*BASE_NAMES, *lite().joint_names), NAMED),
        ([ROWS], (), BARE),
        ([ROWS[:, LEVELS]], (), [*NAMED, "--joint-order", "breadth_first"]),
        ([XYZW, ROWS], (), [*BARE, "--quaternions", "xyzw"]),
    ],
    ids=["named", "times", "base", "bare", "breadth first", "LAFAN1"],
)
def test_a_csv_and_what_must_be_said_of_it(tmp_path, capsys, rows, names, options):
    path = csv(tmp_path, np.concatenate(rows, axis=1), *names)
    for i in range(0, len(options), 2):  # nothing of it is guessed
        assert f"{options[i]}: is " in refusal(capsys, tmp_path, path, *options[:i], *options[i + 2 :])
    assert prepare(tmp_path, path, *options) == 0
    assert "note: without body poses nothing confirms" in capsys.readouterr().out
    assert_sample(tmp_path)


@pytest.mark.parametrize(
    ("rows", "names", "options", "reason"),
    [
        (ROWS[:, LEVELS], (), BARE, "beyond"),
        (np.degrees(ROWS), lite().joint_names, NAMED, "are --joint-order and --degrees right?"),
        (np.concatenate([BASE, ROWS], axis=1), (), [*BARE, "--quaternions", "xyzw"], "upside down"),
        (
            np.concatenate([BASE * [1, 1, 1000, 1, 1, 1, 1], ROWS], axis=1),
            (),
            [*BARE, "--quaternions", "wxyz"],
            "500 m high",
        ),
        (np.concatenate([BASE, TIMES, ROWS], axis=1), (), BARE, "has 22 columns, expected 14 joints, or 21 with"),
        (ROWS[:, 1:], lite().joint_names[1:], NAMED, f"lacks {lite().joint_names[0]}"),
        (
            ROWS[:, [*range(14), 3]],
            lite().joint_names + lite().joint_names[3:4],
            NAMED,
            "left_elbow_pitch more than once",
        ),
        (ROWS, lite().joint_names, [*NAMED, "--joint-order", "robot"], "--joint-order: is given, but "),
        (ROWS, lite().joint_names, ["--fps", "1e-9"], "frame 1 comes 1e+09 s after the one before"),
        (np.concatenate([TIMES[::-1], ROWS], axis=1), ("time", *lite().joint_names), [], "frame 1 comes -0.02 s after"),
    ],
)
def test_a_csv_that_does_not_fit(tmp_path, capsys, rows, names, options, reason):
    assert reason in refusal(capsys, tmp_path, csv(tmp_path, rows, *names), *options)


def test_the_motion_of_a_policy_with_an_anchor_is_in_the_world(tmp_path):
    """From quaternions of any sign, and from the base and the joints alone."""
    contract = contract_of(
        lite().joint_names[::-1],
        task_type="tracking",
        observation=("motion_command", "motion_anchor_ori_b"),
        command_names=("motion",),
        body_names=("chest", "left_hand"),
        anchor_body="chest",
    )
    metadata = {**write_metadata(contract), STAMP_KEY: encode(contract)}
    policy = saved(tmp_path / "p.onnx", linear_model(metadata, inputs=2 * 14 + 6, outputs=14))
    signs = np.where(np.arange(FRAMES) % 3 == 1, -1.0, 1.0)[:, None, None]
    bodies = [SKELETON.bodies.index(name) for name in contract.body_names]
    for path, options in (
        (npz(tmp_path, body_quat_w=signs * TURNS), ["--joint-order", "robot", "--body-order", "mjcf"]),
        (csv(tmp_path, np.concatenate([BASE, ROWS], axis=1), *BASE_NAMES, *lite().joint_names), NAMED),
    ):
        given = ["--policy", policy, "--robot", "lite", "--motion", path, "--output", tmp_path / "out", "--overwrite"]
        assert run_program(main, [*map(str, given), *options]) == 0
        motion = made(tmp_path)
        assert (motion.layout, motion.joint_names) == ("joints_bodies_w", contract.joint_names)
        assert motion.body_names == contract.body_names
        angles, speeds, points, turns = np.split(motion.frames, [14, 28, 34], axis=1)
        np.testing.assert_allclose(angles, ROWS[:, ::-1], atol=1e-6)
        np.testing.assert_allclose(speeds, SPEEDS[:, ::-1], atol=2e-3)
        np.testing.assert_allclose(points.reshape(FRAMES, 2, 3), POINTS[:, bodies], atol=1e-5)
        turns = turns.reshape(FRAMES, 2, 4)
        np.testing.assert_allclose(np.abs((turns * TURNS[:, bodies]).sum(axis=-1)), 1.0, atol=1e-6)
        assert ((turns[1:] * turns[:-1]).sum(axis=-1) > 0.0).all()


def bag(tmp_path, q, *topics, joints=()):
    """A file of rosbag2 with joint states at 200 Hz, not quite evenly, as a robot's driver publishes them."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    header, stamp = store.types["std_msgs/msg/Header"], store.types["builtin_interfaces/msg/Time"]
    state = store.types["sensor_msgs/msg/JointState"]
    jitter = np.random.default_rng(3).integers(0, 1_000_000, len(q))
    with Writer(tmp_path / "dance", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic in topics:
            connection = writer.add_connection(topic, state.__msgtype__, typestore=store)
            for i, row in enumerate(q):
                time = 10**18 + 5_000_000 * i + int(jitter[i])
                names, values = ["gripper", *(joints or lite().joint_names)], np.array([0.5, *row])
                message = state(header(stamp(*divmod(time, 10**9)), ""), names, values, np.zeros(0), np.zeros(0))
                writer.write(connection, time, store.serialize_cdr(message, state.__msgtype__))
    (path,) = (tmp_path / "dance").glob("*.mcap")
    return path


Q_200_HZ = ROWS[0] + np.linspace(0.0, 1.0, 200)[:, None] * (ROWS[-1] - ROWS[0])


def test_joint_states_of_another_robots_driver(tmp_path, capsys):
    """Where there are several topics, one has to be named."""
    path = bag(tmp_path, Q_200_HZ, "/left", "/right")
    assert "--topic: is missing" in refusal(capsys, tmp_path, path)
    assert "'/legs'; known: /left, /right" in refusal(capsys, tmp_path, path, "--topic", "/legs")
    assert prepare(tmp_path, path, "--topic", "/right", "--resample", "--name", "dance") == 0
    np.testing.assert_allclose(made(tmp_path).frames, joint_frames(lite(), Q_200_HZ[::4]), atol=0.005)
    assert "is a folder of rosbag2, expected the .mcap file in it" in refusal(capsys, tmp_path, path.parent)
    path.write_bytes(b"frames: 3")
    assert "is not a whole MCAP file of joint states" in refusal(capsys, tmp_path, path)


@pytest.mark.parametrize(
    ("joints", "reason"),
    [
        (lite().joint_names[:-1], f"/states: lacks {lite().joint_names[-1]}"),
        ([f"g1/{name}" for name in lite().joint_names], "/states has gripper, g1/left_shoulder_pitch, "),
    ],
)
def test_joint_states_of_other_joints(tmp_path, capsys, joints, reason):
    assert reason in refusal(capsys, tmp_path, bag(tmp_path, Q_200_HZ[:, : len(joints)], "/states", joints=joints))


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--wandb-run-path", "a/b/c"], "--policy and --wandb-run-path: both are given"),
        (["--motion", "dance.bvh"], "--motion: is 'dance.bvh', expected"),
        (["--motion", __file__], f"--motion: is '{__file__}', expected"),
        (["--motion", "x.npz", "--song", "ode_to_joy"], "--motion and --song: both are given"),
        (["--motion", "x.npz", "--fps", "50"], "--fps: is given, but x.npz is no .csv"),
        (["--motion", "x.NPZ", "--episode", "1"], "--episode: is given, but x.NPZ is no dataset"),
        (["--motion", "x.csv", "--fps", "1e9"], "--fps: is 1e+09, expected"),
        (["--policy", "lite_biped_velocity", "--robot", "lite_biped"], "is a policy of task_type locomotion"),
        (["--motion", "x.npz", "--robot", "lite_biped"], ".onnx on robot 'lite_biped': unknown joint 'left_shoulder_p"),
    ],
)
def test_options_that_make_no_sense(tmp_path, capsys, options, reason):
    given = [] if "--policy" in options else ["--policy", str(POLICY)]
    assert run_program(main, [*given, "--output", str(tmp_path / "out"), *options]) == 2
    assert reason in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.fixture
def midi(tmp_path):
    track = mido.MidiTrack()
    for note in (60, 64, 67, 105):
        track += [mido.Message("note_on", note=note), mido.Message("note_off", note=note, time=480)]
    file = mido.MidiFile()
    file.tracks.append(track)
    path = tmp_path / "a tune.mid"
    file.save(path)
    return path


def prepare_song(midi, *words):
    given = ["--song", str(midi), "--robot", "lite_piano", "--output", str(midi.parent / "out")]
    return run_program(main, [*given, *words])


def test_a_song_becomes_goals_within_the_robot_s_reach(midi, capsys):
    assert prepare_song(midi, "--fps", "25") == 0
    motion = read_motion(midi.parent / "out" / "a_tune.mcap")
    assert (motion.task_type, motion.policy_dt, motion.robot) == ("piano", 0.04, "lite_piano")
    assert np.flatnonzero(motion.frames.any(axis=0)).tolist() == [39, 43, 46]
    assert not motion.frames[:25].any()  # the hands come over the keys
    printed = capsys.readouterr().out
    assert "3 of 4 notes" in printed
    assert "left out, beyond reach or too many at a time: A7" in printed


def test_a_song_for_a_policy_has_its_rate(midi, capsys):
    assert prepare_song(midi, "--policy", "lite_tracking") == 2
    assert "task_type tracking, expected piano" in capsys.readouterr().err
    assert not (midi.parent / "out").exists()
    assert prepare_song(midi, "--policy", "lite_piano", "--fps", "10") == 2
    assert "--fps: is given" in capsys.readouterr().err
    assert prepare_song(midi, "--policy", "lite_piano", "--name", "low") == 0
    assert read_motion(midi.parent / "out" / "low.mcap").policy_dt == 0.02
