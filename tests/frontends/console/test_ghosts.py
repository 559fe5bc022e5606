"""The second figures, in viser itself."""

import contextlib
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

pytest.importorskip("mjviser", reason="viser and mjviser are not installed (extra 'console')")

from humanoid_sim.frontends.console.scene import Scene
from humanoid_sim.messages import Mode
from humanoid_sim.mit import MITCommand
from humanoid_sim.recording.reader import open_recording
from humanoid_sim.rendering.ghost import ReferenceGhost
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.simulation.model import build_model
from humanoid_sim.simulation.mujoco_robot import MujocoRobot
from humanoid_sim.stack import no_policy, recorded_policy

RECORDING = Path(__file__).parents[2] / "data" / "recordings" / "simulated_locomotion.mcap"


@pytest.fixture(scope="module")
def ticks():
    return list(open_recording(RECORDING).ticks())


@pytest.fixture
def scene(runtime):
    header = open_recording(RECORDING).header
    description = RobotDescription.from_json(header.documents["robot"])
    loaded = recorded_policy(header, no_policy)
    ghost = ReferenceGhost.of(description, loaded.contract, loaded.reference)
    scene = Scene(runtime / "v", build_model(description), description, ghost)
    yield scene
    scene.close()


def play(scene, ticks, until):
    """To the tenth tick in a mode, so that what was commanded there is under way."""
    left = 10
    for record in ticks:
        scene.ghosts.look(record)
        left -= record.output.control_mode.mode is until
        if not left:
            scene.show(record)
            return record
    raise AssertionError(f"never in {until.name}")


def hand(scene, figure):
    """Where a figure's left hand is drawn, m; None while it is not drawn."""
    found = scene.ghosts.figures.get(figure)
    is_drawn = found is not None and found.root.visible
    return found.bodies[hand_of(scene)].position if found is not None and is_drawn else None


def hand_of(scene):
    return int(scene._model.jnt_bodyid[scene._model.joint("left_wrist_pitch").id])


def hand_at(scene, qpos):
    data = mujoco.MjData(scene._model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(scene._model, data)
    return data.xpos[hand_of(scene)]


def test_the_reference_is_drawn_while_the_policy_drives(scene, ticks):
    play(scene, ticks, Mode.STANDBY)
    assert hand(scene, "reference") is None
    assert scene.ghosts.told()["reference"] == {"on": True, "why": "the policy does not drive the robot"}
    record = play(scene, ticks, Mode.LOCOMOTION)
    assert scene.ghosts.told()["reference"] == {"on": True, "why": ""}
    away = np.linalg.norm(hand(scene, "reference") - hand_at(scene, record.qpos))
    assert 1e-4 < away < 0.05  # the policy follows, but never exactly
    assert scene.ghosts.switch("reference", on=False) == ""
    scene.show(record)
    assert hand(scene, "reference") is None


def test_the_commanded_pose_is_drawn_where_something_is_commanded(scene, ticks):
    assert hand(scene, "command") is None
    assert scene.ghosts.switch("command", on=True) == ""
    play(scene, ticks, Mode.DAMPING)
    assert hand(scene, "command") is None
    assert scene.ghosts.told()["command"] == {"on": True, "why": "no position is commanded: K_p is 0"}
    record = play(scene, ticks, Mode.LOCOMOTION)
    commanded = record.qpos.copy()
    commanded[scene._addresses.qpos] = record.output.command.position
    np.testing.assert_allclose(hand(scene, "command"), hand_at(scene, commanded), atol=1e-9)
    assert np.linalg.norm(hand(scene, "command") - hand_at(scene, record.qpos)) > 0.005


def test_contacts_are_drawn_and_a_camera_that_stands_sees_at_first_what_it_saw(runtime, ticks):
    robot = MujocoRobot(load_robot("lite_biped"), support=False, base_position=(2.0, 1.0))
    for _ in range(40):
        robot.write(MITCommand.zeros(len(robot.joints)))
    record, base = replace(ticks[0], qpos=robot.qpos), robot.qpos[:3]
    with contextlib.closing(Scene(runtime / "b", build_model(robot.description), robot.description)) as scene:
        camera, drawn = scene._server.initial_camera, scene._scene._decor_handles
        seen = camera.look_at + base
        for on in (True, False):
            assert scene.switch("contacts", on=on) == ""
            scene.show(record)
            places = np.concatenate([one.batched_positions for one in drawn.values()]) if drawn else np.zeros((0, 3))
            assert len(places) >= 4 if on else not any(one.visible for one in drawn.values())
            assert np.all(np.abs(places[:, 2] + base[2]) < 0.02)  # on the floor, as the scene is shifted
        for on, shift in ((False, 0.0), (False, 0.0), (True, base)):
            assert scene.switch("follow", on=on) == ""
            scene.show(record)
            assert scene.told()["follow"] == {"on": on, "why": ""}
            np.testing.assert_allclose(camera.look_at + shift, seen)
            np.testing.assert_allclose(scene._scene.fixed_bodies_frame.position, -np.ones(3) * shift, atol=1e-9)


def test_what_cannot_be_drawn_is_refused(scene, ticks):
    assert scene.ghosts.switch("halo", on=True) == "show: is 'halo', expected one of reference, command"
    scene.ghosts._reference = None
    assert scene.ghosts.switch("reference", on=True) == "show: the policy follows no motion that can be shown"
    assert list(scene.ghosts.told()) == ["command"]
    assert scene.switch("follow", on=True) == "show: is 'follow', expected one of reference, command"  # it stands still
    scene.show(replace(ticks[0], qpos=None))  # as on hardware
