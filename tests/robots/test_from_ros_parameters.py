"""Robot files of ROS 2 parameters, in the forms that launch files and spawners take."""

import pytest
import yaml

from humanoid_sim.errors import InputError
from humanoid_sim.robot import main
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.from_ros_parameters import convert_parameters

LITE = load_robot("lite")
NAMES = list(LITE.joint_names)
READY = [0.3, -1.0, 0.0, -1.7, -1.2, 0.0, 0.3, 0.3, 1.0, 0.0, -1.7, 1.2, 0.0, -0.3]
OTHER = [0.1 if name == "left_shoulder_roll" else 0.0 for name in NAMES]


def standby(pose, **changes):
    values = {
        "joints": NAMES,
        "target_stiffness": [20.0 + i for i in range(14)],
        "target_damping": [2.0] * 14,
        "segment_durations": [2.0, 3.0],
        "pose_segment_0": [0.0] * 14,
        "pose_segment_1": pose,
    }
    return {"ros__parameters": {name: value for name, value in {**values, **changes}.items() if value is not None}}


def bringup(**nodes):
    document = {
        "controller_manager": {"ros__parameters": {"update_rate": 40, "standby_controller_a": {"type": "x"}}},
        "damping_controller": {"ros__parameters": {"damping_scalar": 4.5}},
        "standby_controller_a": standby(READY),
        "standby_controller_b": standby(OTHER),
        "remote_policy_controller": {
            "ros__parameters": {"stale_command_policy": "hold", "stale_command_timeout_ms": 80}
        },
        "mode_manager": {"ros__parameters": {"joy.damp_button": 3}},
        "/**": {"ros__parameters": {"use_sim_time": False}},
    }
    return {**document, **nodes}


def written(folder, document):
    path = folder / "controllers.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    return path


def test_a_bringup_file_becomes_a_robot_file(tmp_path, capsys):
    source, output = written(tmp_path, bringup()), tmp_path / "my_lite.yaml"
    assert main(["convert", str(source), "--robot", "lite", "-o", str(output)]) == 0
    assert capsys.readouterr().out.splitlines() == [
        f"wrote {output}",
        "left out:",
        "  all nodes: use_sim_time",
        "  controller_manager: standby_controller_a",
        "  mode_manager: joy (gamepad bindings: play --gamepad FILE reads them)",
    ]
    robot = load_robot(output)
    assert robot.joints == LITE.joints
    assert robot.mjcf_path == LITE.mjcf_path
    assert robot.hardware.control_frequency == 40.0
    assert robot.damping_controller.damping_scalar == 4.5
    assert robot.standby_controller_a.pose_segments == ((0.0,) * 14, tuple(READY))
    assert robot.standby_controller_b.pose_segments == ((0.0,) * 14, tuple(OTHER))
    assert robot.standby_controller_a.segment_durations == (2.0, 3.0)
    assert robot.standby_controller_a.target_stiffness == tuple(20.0 + i for i in range(14))
    assert robot.remote_policy_controller.stale_command_policy == "hold"
    assert robot.remote_policy_controller.stale_command_timeout_ms == 80.0


def test_lists_follow_the_robot_s_order_of_joints(tmp_path):
    turned = standby(READY[::-1], joints=NAMES[::-1])
    source = written(tmp_path, bringup(standby_controller_a=turned))
    document, _ = convert_parameters(source, "lite", tmp_path)
    assert document["standby_controller_a"]["pose_segments"][1] == READY
    assert document["standby_controller_a"]["target_stiffness"][0] == 33.0


@pytest.mark.parametrize("document", [{"/**": standby(READY)}, {"/**": {"standby_controller_a": standby(READY)}}])
def test_parameters_of_a_spawner_s_file(tmp_path, document):
    found, left_out = convert_parameters(written(tmp_path, document), "lite", tmp_path)
    assert found["standby_controller_a"]["pose_segments"][1] == READY
    assert left_out == []


def test_an_mjcf_gets_gains_and_poses(tmp_path):
    mjcf = tmp_path / "arm.xml"
    mjcf.write_text(
        '<mujoco model="arm"><worldbody><body name="base"><joint name="elbow" range="-60 60" limited="true"/>'
        '<geom size="0.1" mass="1"/></body></worldbody></mujoco>'
    )
    lists = {"target_stiffness": [30.0], "target_damping": [1.5], "pose_segment_0": [0.0], "pose_segment_1": [0.5]}
    source = written(tmp_path, {"standby_controller_a": standby([0.0], joints=["elbow"], **lists)})
    output = tmp_path / "arm.yaml"
    assert main(["convert", str(source), "--robot", str(mjcf), "-o", str(output)]) == 0
    robot = load_robot(output)
    assert (robot.joints[0].stiffness, robot.joints[0].damping) == (30.0, 1.5)
    assert robot.standby_controller_a.pose_segments == ((0.0,), (0.5,))


@pytest.mark.parametrize(
    ("document", "why"),
    [
        ({}, "has no parameters of standby_controller_a, standby_controller_b, damping_controller"),
        ({"joints": NAMES}, "has no parameters of standby_controller_a"),
        (bringup(standby_controller_a=standby(READY[:3])), r"pose_segment_1: is \[0.3, -1.0, 0.0\], expected 14"),
        (
            bringup(standby_controller_a=standby(READY, pose_segment_0=None)),
            "has pose_segment_1, expected pose_segment_0",
        ),
        (bringup(standby_controller_a=standby(READY, segment_durations=None)), "expected segment_durations, s"),
        (bringup(standby_controller_a=standby(READY, joints=["elbw"])), "joints: unknown joint 'elbw'"),
        (bringup(standby_controller_a=standby(READY, joints=NAMES[1:])), "joints: lacks left_shoulder_pitch of 'lite'"),
        (bringup(standby_controller_a=standby([9.0] * 14)), r"standby_controller_a.pose_segments\[1\]"),
        (
            bringup(damping_controller={"ros__parameters": {"damping_scalar": -1.0}}),
            "damping_controller.damping_scalar",
        ),
        (bringup(damping_controller={"ros__parameters": {"damping_scalar": "x"}}), "damping_controller.damping_scalar"),
    ],
)
def test_what_is_wrong_is_one_line_and_nothing_is_written(tmp_path, document, why):
    source, output = written(tmp_path, document), tmp_path / "robot.yaml"
    with pytest.raises(InputError, match=why) as error:
        main(["convert", str(source), "--robot", "lite", "-o", str(output)])
    assert str(error.value).startswith(f"{source}: ")
    assert not output.exists()


URDF = "<robot name='a'><link name='b'/></robot>"


@pytest.mark.parametrize(
    ("text", "options", "why"),
    [
        (None, (), "^--robot: is missing; .* holds parameters of a robot"),
        (None, ("--robot", "lite"), "^--output: is missing"),
        (None, ("--robot", "lite", "-o", "x.yaml", "--base", "fixed"), "^--base: is fixed, which means nothing for"),
        (URDF, (), r"^--base: is missing; a URDF does not say it, expected floating or fixed$"),
        (URDF, ("--base", "fixed", "--robot", "lite"), r"^--robot: is lite, which means nothing for"),
    ],
)
def test_options_of_a_parameter_file_and_of_a_urdf(tmp_path, text, options, why):
    (tmp_path / "robot.urdf").write_text(text or "")
    source = written(tmp_path, bringup()) if text is None else tmp_path / "robot.urdf"
    with pytest.raises(InputError, match=why):
        main(["convert", str(source), *options])
