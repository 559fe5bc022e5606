"""The piano policy's rule, what it sees, and the shipped graph, which must do the same."""

from __future__ import annotations

import numpy as np
import onnxruntime
import pytest

from humanoid_sim.assets import PIANO_POLICY
from humanoid_sim.evaluation.key_poses import KeyPoses
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.robots.description import load_robot
from humanoid_sim.training.piano.hands import BOTTOM, FAR, HOVERING, LEVELS, QUARTERS, Motion, pose_grid
from humanoid_sim.training.piano.trace import piano_run

OFFSETS = (0, *range(1, 13), *range(14, 31, 2), *range(35, 61, 5))


def steps(place: int, level: int, target: int, wait: float, left: float, count: int) -> list[tuple[int, int]]:
    found = []
    for i in range(count):
        there, moved = Motion().step(
            np.array(place), np.array(level), np.array(target), np.array(max(wait - i, 0.0)), np.array(left - i)
        )
        place, level = int(there), int(moved)
        found.append((place, level))
    return found


def test_a_hand_goes_to_its_key_lifted_and_presses_it_in_time() -> None:
    way = steps(0, HOVERING, 28, wait=20.0, left=30.0, count=34)
    places, levels = [place for place, _ in way], [level for _, level in way]
    assert places == sorted(places)
    assert places[-1] == 28
    assert min(levels) == 1, "lifted in between"
    assert levels[13] == HOVERING, "over its key, and waits"
    assert levels[14:18] == [5, 6, 7, BOTTOM], "from six steps before the note"
    assert levels[27] == BOTTOM
    assert levels[28:30] == [6, HOVERING], "up from two steps before its end"


def test_a_hand_leaves_a_key_before_it_goes_elsewhere() -> None:
    way = steps(8, BOTTOM, 16, wait=FAR, left=FAR, count=8)
    assert way[:3] == [(8, 6), (8, HOVERING), (12, 3)]
    assert way[-1] == (16, HOVERING)


@pytest.fixture(scope="module")
def poses() -> KeyPoses:
    return KeyPoses.of(load_robot("lite_piano"), range(28, 60))


def test_the_grid_is_the_player_s_poses(poses: KeyPoses) -> None:
    low = poses.keys[0][0]
    grid = pose_grid(poses, 0)
    assert grid.shape == ((poses.keys[0][-1] - low) * QUARTERS + 1, len(LEVELS), 7)
    for key in poses.keys[0]:
        place = (key - low) * QUARTERS
        assert grid[place, 0] == pytest.approx(poses.table[0, 0, key])
        assert grid[place, HOVERING] == pytest.approx(poses.table[0, 1, key])
        assert grid[place, BOTTOM] == pytest.approx(poses.table[0, 3, key])
    assert np.abs(np.diff(grid[:, : HOVERING + 1], axis=0)).max() < 0.1  # rad from one place to the next


def observed(last: np.ndarray, table: np.ndarray, frame: int) -> np.ndarray:
    rows = np.minimum(frame + np.array(OFFSETS), len(table) - 1)
    return np.concatenate([last, np.zeros(88), table[rows].ravel()])[None].astype(np.float32)


def test_the_shipped_policy_strikes_what_a_song_asks_for() -> None:
    """Open loop: its commands go to the bottom of G3 and D5, each by one hand, in time, and come back."""
    checkpoint = load_checkpoint(PIANO_POLICY)
    contract = checkpoint.contract
    assert (contract.task_type, contract.policy_dt, contract.lookahead_steps) == ("piano", 0.02, OFFSETS[1:])
    session = onnxruntime.InferenceSession(str(PIANO_POLICY), providers=["CPUExecutionProvider"])
    table = np.zeros((120, 88))
    table[60:80, 34] = table[70:100, 53] = 1.0
    grids = {hand: pose_grid(KeyPoses.of(load_robot("lite_piano"), range(30, 58)), hand) for hand in (0, 1)}
    last, commands = np.zeros(14), []
    for frame in range(120):
        last = session.run(None, {"obs": observed(last, table, frame)})[0][0]
        commands.append(contract.default_joint_pos + last)
    down = np.zeros((120, 2), dtype=bool)
    for hand, key in ((0, 34), (1, 53)):
        low = 30 if hand == 0 else 32
        bottom = grids[hand][(key - low) * QUARTERS, BOTTOM]
        down[:, hand] = [np.abs(command[7 * hand : 7 * hand + 7] - bottom).max() < 1e-4 for command in commands]
    assert np.flatnonzero(down[:, 0]).tolist() == list(range(57, 78))
    assert np.flatnonzero(down[:, 1]).tolist() == list(range(67, 97))


def test_the_shipped_policy_carries_samples_of_its_trainers_run() -> None:
    assert load_checkpoint(PIANO_POLICY).golden == "8 samples of the trainer's run (lite_piano.npz)"


def test_the_trainers_run_plays_the_song_and_is_a_trace() -> None:
    robot = load_robot("lite_piano")
    table = np.zeros((120, 88))
    table[60:80, 34] = 1.0
    run = piano_run(PIANO_POLICY, robot, table, seconds=1.9)
    assert run["obs"].shape == (95, 14 + 88 + 28 * 88)
    assert (run["obs"][0, :14] == 0.0).all(), "no action came before the first"
    np.testing.assert_array_equal(run["obs"][1:, :14], run["action"][:-1])
    np.testing.assert_array_equal(run["obs"][:, 14:102], run["key_pressed"])
    assert np.flatnonzero(run["key_pressed"].any(axis=0)).tolist() == [34]
    assert 60 <= np.flatnonzero(run["key_pressed"][:, 34])[0] <= 66
