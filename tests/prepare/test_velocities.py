"""Joint velocities against joint positions: planted mistakes are named, and no way of taking differences is one."""

import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from motion_samples import FPS, joint_path, lite

from humanoid_sim.errors import InputError
from humanoid_sim.prepare.velocities import check_rate, check_velocities, refuse_velocities
from humanoid_sim.recording.reader import open_recording
from tools.samples.motions import SAMPLES, sample_motion

JOINTS = lite().joint_names
ELBOW = 3
PATHS = ("short", "long", *SAMPLES)


@cache
def path_of(name):
    lengths = {"short": 40, "long": 300}
    return joint_path(lengths[name]) if name in lengths else sample_motion(lite(), name)[1]


def central(q, fps=FPS):
    return np.gradient(q, 1.0 / fps, axis=0)


def forward(q, fps=FPS):
    rate = fps * np.diff(q, axis=0)
    return np.concatenate([rate, rate[-1:]])


def backward(q, fps=FPS):
    rate = fps * np.diff(q, axis=0)
    return np.concatenate([np.zeros_like(rate[:1]), rate])


def late(frames):
    return lambda v: np.concatenate([np.repeat(v[:1], frames, axis=0), v[:-frames]])


def at_elbow(change):
    def changed(v):
        v = v.copy()
        v[:, [ELBOW]] = change(v[:, [ELBOW]])
        return v

    return changed


def exchanged(v):
    v = v.copy()
    v[:, [3, 10]] = v[:, [10, 3]]
    return v


def half_the_time(v):
    return np.where(np.arange(len(v))[:, None] < len(v) // 2, v, 0.0)


def told(q, v, fps=FPS):
    """The refusal; empty for velocities that pass."""
    try:
        refuse_velocities("a.npz", fps, check_rate(q, v, fps), check_velocities(q, v, fps, JOINTS), len(JOINTS))
    except InputError as error:
        return str(error)
    return ""


def faults(q, v, fps=FPS):
    return [check for check in check_velocities(q, v, fps, JOINTS) if check.fault]


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("difference", [central, forward, backward])
@pytest.mark.parametrize("step", [1, 2, 5])
def test_differences_of_any_kind_pass(path, difference, step):
    q, fps = path_of(path)[::step], FPS / step
    assert faults(q, difference(q, fps), fps) == []


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("step", [2, 5])
def test_the_true_derivative_of_coarse_frames_passes(path, step):
    assert faults(path_of(path)[::step], central(path_of(path))[::step], FPS / step) == []


@pytest.mark.parametrize("path", PATHS)
def test_measured_velocities_pass(path):
    rng = np.random.default_rng(0)
    q = path_of(path)
    v = central(q)
    noisy = q + rng.normal(0.0, 0.001, q.shape)
    assert faults(noisy, v + rng.normal(0.0, 0.05, q.shape)) == []
    assert faults(noisy, central(noisy)) == []
    smoothed = np.zeros_like(v)  # a first-order filter, two frames late
    for i in range(1, len(v)):
        smoothed[i] = smoothed[i - 1] + 0.5 * (v[i] - smoothed[i - 1])
    assert faults(noisy, smoothed) == []


PLANTED = {
    "zero": (lambda v: 0.0 * v, "all 14 joints: velocities are all zero"),
    "one zero": (at_elbow(lambda v: 0.0 * v), "left_elbow_pitch: velocities are all zero"),
    "one halved": (at_elbow(lambda v: 0.5 * v), "left_elbow_pitch: velocities are 0.5 times the derivative"),
    "one twice": (at_elbow(lambda v: 2.0 * v), "left_elbow_pitch: velocities are 2 times the derivative"),
    "one too large": (at_elbow(lambda v: 1.3 * v), "left_elbow_pitch: velocities are 1.3 times the derivative"),
    "one negative": (at_elbow(lambda v: -v), "left_elbow_pitch: velocities are -1 times the derivative"),
    "negative": (lambda v: -v, "all 14 joints: velocities are -1 times the derivative"),
    "late": (late(10), "velocities are unlike the derivative"),
    "rolled": (lambda v: np.roll(v, -10, axis=0), "velocities are unlike the derivative"),
    "degrees": (np.degrees, "all 14 joints: velocities are in degrees per second, and the positions in radians"),
    "per frame": (lambda v: v / FPS, "all 14 joints: velocities are per frame, not per second"),
    "noise": (
        lambda v: np.random.default_rng(0).normal(size=v.shape),
        "all 14 joints: velocities are unlike the derivative",
    ),
    "rate": (lambda v: 0.6 * v, "fps is 50, but its joint velocities match 30.0 frames per second"),
}


@pytest.mark.parametrize("path", ["short", "long", "reach"])
@pytest.mark.parametrize("name", PLANTED)
def test_a_planted_mistake_is_named(path, name):
    change, words = PLANTED[name]
    message = told(path_of(path), change(central(path_of(path))))
    assert words in message
    assert message.startswith("a.npz: ")


def test_the_ratio_is_measured():
    q = path_of("long")
    (found,) = faults(q, at_elbow(lambda v: 0.5 * v)(central(q)))
    assert found.joint == "left_elbow_pitch"
    assert found.ratio == pytest.approx(0.5, abs=0.01)
    assert found.correlation > 0.999


def test_what_a_simulated_robot_did_passes():
    """Its wrists jump and settle within each policy step: their speed at its end is less than the mean speed."""
    recording = Path(__file__).parents[1] / "data" / "recordings" / "simulated_locomotion.mcap"
    states = [tick.input.state for tick in open_recording(recording).ticks() if tick.output.policy_step is not None]
    q, v = (np.array([getattr(state, name) for state in states]) for name in ("joint_position", "joint_velocity"))
    assert min(check.ratio for check in check_velocities(q, v, FPS, JOINTS)) < 0.85
    assert told(q, v) == ""


def test_velocities_of_another_joint():
    found = faults(path_of("long"), exchanged(central(path_of("long"))))
    assert [(check.joint, check.fault) for check in found] == [
        ("left_elbow_pitch", "unlike the derivative of the positions"),
        ("right_elbow_pitch", "unlike the derivative of the positions"),
    ]


@pytest.mark.parametrize("path", ["long", "wave", "circle", "drum"])
def test_velocities_that_stop_halfway(path):
    assert "velocities are unlike the derivative" in told(path_of(path), half_the_time(central(path_of(path))))


def test_degrees_in_the_positions_alone():
    q = path_of("long")
    words = "all 14 joints: velocities are in radians per second, and the positions in degrees"
    assert words in told(np.degrees(q), central(q))


def test_a_joint_that_stands_and_claims_to_move():
    q = path_of("long").copy()
    q[:, ELBOW] = 0.3
    v = central(path_of("long"))
    (found,) = faults(q, v)
    assert (found.joint, found.ratio) == ("left_elbow_pitch", math.inf)
    assert "left_elbow_pitch: velocities are up to" in told(q, v)
    assert "rad/s, and it hardly moves" in told(q, v)


def test_five_of_fourteen_joints():
    v = central(path_of("long"))
    v[:, :5] = 0.0
    words = "left_shoulder_pitch, left_shoulder_roll, left_shoulder_yaw and 2 more: velocities are all zero"
    assert words in told(path_of("long"), v)


def test_the_rate_that_velocities_fit():
    q = joint_path()
    rate = central(q)
    found = check_rate(q, rate, 30.0)
    assert found.fps == pytest.approx(50.0)
    assert found.correlation == pytest.approx(1.0)
    shuffled = check_rate(q, rate[:, ::-1], 50.0)
    assert shuffled.correlation < 0.5


def test_a_motion_too_short_or_too_still_says_nothing():
    q = joint_path()
    assert check_rate(q[:11], q[:11], 50.0) is None
    assert check_velocities(q[:11], q[:11], 50.0, JOINTS) == ()
    assert check_rate(np.zeros_like(q), q, 50.0) is None
    assert check_velocities(np.zeros_like(q), np.zeros_like(q), 50.0, JOINTS) == ()
