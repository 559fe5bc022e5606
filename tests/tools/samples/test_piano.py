"""The piano policy's rule, what it sees, and the shipped graph, which must do the same."""

import numpy as np
import onnxruntime
import pytest

from humanoid_sim.assets import PIANO_POLICY
from humanoid_sim.evaluation.key_poses import ABOVE, PRESSED, KeyPoses
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.robots.description import load_robot
from tools.samples.piano.hands import FAR, NONE, Motion, home, moves_of, ways_of
from tools.samples.piano.trace import piano_run

OFFSETS = (0, *range(1, 13), *range(14, 31, 2), *range(35, 61, 5))
KEYS = range(28, 60)
"""Some that both hands have, and where each is at home."""


@pytest.fixture(scope="module")
def ways():
    robot = load_robot("lite_piano")
    return ways_of(robot, KeyPoses.of(robot, KEYS))


@pytest.fixture(scope="module")
def moves(ways):
    return moves_of(ways, 0), moves_of(ways, 1)


def steps(moves, pointed, wait, left, count, rows=None, again=FAR):
    """The rows of both hands, shape (count, S, 2), that are pointed at keys, shape (S, 2)."""
    rows = np.tile(home(moves), (len(pointed), 1)) if rows is None else rows
    found = []
    for step in range(count):
        times = (np.full(pointed.shape, max(value - step, 0.0)) for value in (wait, left, again))
        rows = Motion().step(moves, rows, pointed, *times)
        found.append(rows)
    return np.array(found)


def test_a_hand_goes_to_its_key_and_presses_it_in_time(moves):
    own = moves[0]
    rows = steps(moves, np.array([[37, NONE]]), wait=30.0, left=50.0, count=60)[:, 0, 0]
    assert (own.key[rows] == 37).all(), "from its first step on it says where it goes"
    assert own.origin[rows].tolist() == [30] * 7 + [37] * 53
    assert np.flatnonzero(own.is_over[rows]).tolist() == [*range(7, 24), *range(52, 60)]
    assert np.flatnonzero(own.depth[rows] > 0.0).tolist() == list(range(24, 52)), "from six steps before the note"
    assert np.flatnonzero(own.depth[rows] == 1.0).tolist() == list(range(30, 50)), "up from a step before its end"
    assert rows[-1] == own.over[37 - 28]


def test_a_hand_leaves_a_key_before_it_goes_elsewhere(moves):
    own = moves[0]
    begun = np.array([[own.press[2] + own.busy[own.press[2]], home(moves)[1]]])
    assert own.is_down[begun[0, 0]]
    rows = steps(moves, np.array([[40, NONE]]), wait=30.0, left=50.0, count=14, rows=begun)[:, 0, 0]
    assert own.depth[rows].tolist() == pytest.approx([1.0, 2 / 3, 1 / 3, *[0.0] * 11])
    assert own.key[rows].tolist() == [30] * 4 + [40] * 10


def test_hands_keep_apart_wherever_they_are_pointed(moves):
    """From every pair of keys that they may be over to every pair, whichever note comes first."""
    left, right = moves
    pairs = [(a, b) for a in KEYS[::3] for b in KEYS[::3]]
    starts = [(a, b) for a, b in pairs if b - a >= 5 and right.lowest <= b and a <= left.highest]
    cases = np.array([(*start, *aim) for start in starts for aim in pairs])
    rows = np.stack([left.over[cases[:, 0] - left.lowest], right.over[cases[:, 1] - right.lowest]], axis=-1)
    rng = np.random.default_rng(0)
    wait = rng.integers(0, 40, (len(cases), 2)).astype(float)
    for _ in range(40):
        rows = Motion().step(moves, rows, cases[:, 2:], wait, *np.full((2, *wait.shape), FAR))
        far = np.maximum(left.key[rows[:, 0]], left.origin[rows[:, 0]])
        near = np.minimum(right.key[rows[:, 1]], right.origin[rows[:, 1]])
        assert (near - far).min() >= 5
        wait = np.maximum(wait - 1.0, 0.0)
    assert len(cases) == len(starts) * 121


def test_a_key_that_sounds_again_is_released_in_time(moves):
    own = moves[0]
    begun = np.array([[own.follows[own.press[2] + own.busy[own.press[2]]], home(moves)[1]]])
    rows = steps(moves, np.array([[30, NONE]]), wait=0.0, left=17.0, count=21, rows=begun, again=20.0)[:, 0, 0]
    assert np.flatnonzero(own.is_down[rows]).tolist() == [*range(10), 20], "until ten steps before it"
    assert np.flatnonzero(own.is_over[rows]).tolist() == [13]
    assert own.depth[rows[14:]].tolist() == pytest.approx([share / 7 for share in range(1, 8)]), "at once, and in time"


def test_a_hand_moves_as_the_player_does(ways, moves):
    player = ways.player
    for hand, own in enumerate(moves):
        keys = np.arange(own.lowest, own.highest + 1)
        assert own.command[own.over] == pytest.approx(player.poses.table[hand, ABOVE, keys])
        bottom = own.follows[own.press + own.busy[own.press]]
        assert own.command[bottom] == pytest.approx(player.poses.table[hand, PRESSED, keys])
        press, release = own.press[5], own.release[5]
        assert own.command[press : press + own.busy[press] + 1] == pytest.approx(player.press(hand, keys[5])[1:])
        assert own.command[release : release + own.busy[release] + 1] == pytest.approx(player.release(hand, keys[5]))


def test_a_hand_is_slower_where_its_motors_carry_a_stretched_arm():
    robot = load_robot("lite_piano")
    ways = ways_of(robot, KeyPoses.of(robot, [*range(8, 32), *range(40, 44)]))
    assert [len(ways.release(0, key)) - 1 for key in (8, 12, 30)] == [5, 4, 3]
    pairs = (8, 9), (8, 12), (30, 26), (8, 20), (30, 18)
    assert [len(ways(0, *pair)) for pair in pairs] == [4, 5, 5, 9, 11]
    assert [ways.player.way_steps(*pair) for pair in pairs] == [4, 5, 5, 8, 8], "nowhere is it faster than the player"


def test_the_last_command_tells_what_a_hand_does(moves):
    """In the precision of the graph, and however its commands are rounded on the way through an action."""
    for hand, own in enumerate(moves):
        default = own.command[home(moves)[hand]]
        table = own.command.astype(np.float32)
        action = (table - default.astype(np.float32)).astype(np.float32)
        seen = (action + default.astype(np.float32)).astype(np.float32)
        chosen = np.arange(0, len(table), 7)
        found = np.concatenate(
            [np.square(seen[part, None] - table).sum(axis=2).argmin(axis=1) for part in np.array_split(chosen, 40)]
        )
        for what in (own.key, own.origin, own.busy, own.is_down):
            np.testing.assert_array_equal(what[found], what[chosen])
        assert len(chosen) > 800


def observed(last, table, frame):
    rows = np.minimum(frame + np.array(OFFSETS), len(table) - 1)
    return np.concatenate([last, np.zeros(88), table[rows].ravel()])[None].astype(np.float32)


def test_the_shipped_policy_strikes_what_a_song_asks_for():
    """Open loop: its commands go to the bottom of G3 and D5, each by one hand, in time, and come back; to G3 again."""
    checkpoint = load_checkpoint(PIANO_POLICY)
    contract = checkpoint.contract
    assert (contract.task_type, contract.policy_dt, contract.lookahead_steps) == ("piano", 0.02, OFFSETS[1:])
    session = onnxruntime.InferenceSession(str(PIANO_POLICY), providers=["CPUExecutionProvider"])
    table = np.zeros((120, 88))
    table[60:80, 34] = table[83:105, 34] = table[70:100, 53] = 1.0
    last, commands = np.zeros(14), []
    for frame in range(120):
        last = session.run(None, {"obs": observed(last, table, frame)})[0][0]
        commands.append(contract.default_joint_pos + last)
    poses = KeyPoses.of(load_robot("lite_piano"), range(30, 58))
    down = np.zeros((120, 2), dtype=bool)
    for hand, key in ((0, 34), (1, 53)):
        bottom = poses.table[hand, PRESSED, key]
        down[:, hand] = [np.abs(command[7 * hand : 7 * hand + 7] - bottom).max() < 1e-4 for command in commands]
    assert np.flatnonzero(down[:, 0]).tolist() == [*range(61, 73), *range(84, 101)]
    assert np.flatnonzero(down[:, 1]).tolist() == list(range(71, 98))


def test_the_shipped_policy_carries_samples_of_its_trainers_run():
    assert load_checkpoint(PIANO_POLICY).golden == "8 samples of the trainer's run (lite_piano.npz)"


def test_the_trainers_run_plays_the_song_and_is_a_trace():
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
