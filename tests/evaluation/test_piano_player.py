"""The open-loop player: what it plans, and how it plays in simulation."""

import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.key_poses import KeyPoses
from humanoid_sim.evaluation.piano_player import Goal, PianoPlayer, goals_of
from humanoid_sim.evaluation.piano_score import score
from humanoid_sim.mit import MITCommand
from humanoid_sim.policy.random_songs import held_out_songs
from humanoid_sim.policy.song import goals
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.keys import PianoKeys
from humanoid_sim.simulation.mujoco_robot import MujocoRobot

ROBOT = load_robot("lite_piano")
DT = 0.02


@pytest.fixture(scope="module")
def player():
    return PianoPlayer(ROBOT, DT, poses=KeyPoses.of(ROBOT, [*range(24, 32), *range(55, 63)]))


def song(*notes, frames=160):
    table = np.zeros((frames, 88), dtype=np.float32)
    for key, start, end in notes:
        table[start:end, key] = 1.0
    return table


def performed(player, table, actuation):
    """The score, and the largest force on each key, N."""
    robot, z = MujocoRobot(ROBOT, control_period=DT, actuation=actuation), np.zeros(14)
    keys, force, pressed = PianoKeys(robot.model), np.zeros(88), np.zeros_like(table)
    commands = player.play(table)
    robot.data.qpos[:14] = ROBOT.standby_controller_a.pose_segments[-1]
    for frame, position in enumerate(commands):
        pressed[frame] = keys.pressed(robot.data.qpos)
        robot.write(MITCommand(position, z, z, ROBOT.stiffness, ROBOT.damping))
        force = np.maximum(force, keys.force(robot.model, robot.data))
    return score(pressed, table, DT), force


def test_notes_of_a_table():
    table = song((40, 3, 5), (40, 6, 9), (12, 0, 2), frames=9)
    assert goals_of(table) == [Goal(12, 0, 2), Goal(40, 3, 5), Goal(40, 6, 9)]
    assert goals_of(np.zeros((4, 88))) == []


def test_two_voices_are_played_by_two_hands(player):
    table = song((30, 60, 80), (58, 60, 100), (27, 95, 120), (57, 120, 140))
    plan = player.poses_of(player.plan(table))
    left, right = plan[:, :7], plan[:, 7:]
    assert left[75] == pytest.approx(player.poses.table[0, 3, 30])
    assert right[75] == pytest.approx(player.poses.table[1, 3, 58])
    assert left[110] == pytest.approx(player.poses.table[0, 3, 27])
    assert right[110] == pytest.approx(player.poses.table[1, 1, 57])
    assert np.abs(np.diff(plan, axis=0)).max() < 0.2  # nothing jumps


def test_a_song_sounds_as_it_should_and_no_key_is_hit_too_hard(player):
    table = song((30, 60, 80), (58, 60, 100), (27, 95, 120), (57, 120, 140), (28, 130, 150))
    result, force = performed(player, table, "implicit")
    assert (result.note_count, result.hit_count, result.false_count) == (5, 5, 0)
    assert result.steps.f1 > 0.93
    assert force[[27, 28, 30, 57, 58]].min() > 1.0
    assert force.max() < ROBOT.piano.key_force_limit
    assert np.flatnonzero(force).tolist() == [27, 28, 30, 57, 58]


def test_a_note_that_no_hand_reaches_is_left_out(player):
    table = song((3, 60, 80), (58, 60, 100))
    only = song((58, 60, 100))
    assert (player.play(table) == player.play(only)).all()


def test_a_robot_without_a_piano_is_refused():
    with pytest.raises(InputError, match=r"^lite: has no piano"):
        KeyPoses.of(load_robot("lite"))
    with pytest.raises(InputError, match=r"^lite_piano: its right hand reaches none of the keys"):
        KeyPoses.of(ROBOT, [10, 11])


@pytest.mark.slow
def test_unseen_songs_on_the_reference_plant(table_of):
    player = PianoPlayer(ROBOT, DT)
    rows = table_of("Open-loop player, 20 s each", ("song", "precision", "recall", "F1", "notes hit", "force N"))
    ratios = []
    for i, made in enumerate(held_out_songs(player.poses.keys, 6)):
        result, force = performed(player, goals(made, DT), "qfrc_applied")
        ratios.append((result.steps.precision, result.steps.recall, result.steps.f1))
        shown = (f"{value:.3f}" for value in ratios[-1])
        assert force.max() < ROBOT.piano.key_force_limit
        rows.append((str(i), *shown, f"{result.hit_count}/{result.note_count}", f"{force.max():.1f}"))
    precision, _, f1 = np.mean(ratios, axis=0)
    assert precision > 0.95
    assert f1 > 0.86
