"""In which order frames leave, and how often."""

import numpy as np
import pytest

from humanoid_sim.hardware.motors import MotorGroup
from humanoid_sim.hardware.sito.codec import Command, Gains, Reset, decode
from humanoid_sim.hardware.sito.frames import SitoEncoder, damping_frames, limp_frames, reset_frames
from humanoid_sim.robots.motors import MOTORS

MODEL = MOTORS["TA40-50"]
COMMAND, GAINS = 0, 1


def group(count=2):
    ids = tuple(range(22, 22 + count))
    return MotorGroup(tuple(map(str, ids)), (0,) * count, ids, (MODEL,) * count, (0.0,) * count, (0.0,) * count)


def values(stiffness, damping=1.0, count=2, position=0.0):
    return np.tile(np.array([[position], [0.0], [0.0], [stiffness], [damping]]), (1, count))


def kinds(encoder, what, motor=0):
    return [kind for i, kind, _ in encoder.encode(what).frames if i == motor]


def test_stiffer_gains_go_after_the_command_and_softer_ones_before():
    encoder = SitoEncoder(group())
    assert kinds(encoder, values(20.0)) == [COMMAND, GAINS], "from the zero gains of enabling"
    assert kinds(encoder, values(50.0)) == [COMMAND, GAINS]
    assert kinds(encoder, values(0.0)) == [GAINS, COMMAND]


def test_gains_that_changed_go_three_times_and_then_to_one_motor_a_tick():
    encoder = SitoEncoder(group(4))
    ticks = [encoder.encode(values(20.0, count=4)).frames for _ in range(12)]
    counts = [sum(kind == GAINS for _, kind, _ in tick) for tick in ticks]
    assert counts == [4, 4, 4, 1, 1, 1, 1, 1, 1, 1, 1, 1]
    refreshed = [motor for tick in ticks[3:] for motor, kind, _ in tick if kind == GAINS]
    assert sorted(set(refreshed)) == [0, 1, 2, 3]
    assert all(sum(kind == COMMAND for _, kind, _ in tick) == 4 for tick in ticks)


def test_what_makes_a_motor_soft_goes_first_in_every_tick():
    encoder = SitoEncoder(group(4))
    encoder.encode(values(20.0, count=4))
    for _ in range(10):
        frames = encoder.encode(values(0.0, 2.0, count=4)).frames
        assert [(motor, kind) for motor, kind, _ in frames] == [(i, k) for i in range(4) for k in (GAINS, COMMAND)]


def test_what_does_not_fit_is_cut_off_and_marked():
    encoder = SitoEncoder(group(1))
    asked = np.array([[1e9], [-10.0], [1e3], [501.0], [6.0]])
    encoded = encoder.encode(asked)
    assert encoded.saturated.all()
    found = {type(message): message for message in (decode(frame, MODEL) for _, _, frame in encoded.frames)}
    command, gains = found[Command], found[Gains]
    assert isinstance(command, Command)
    assert isinstance(gains, Gains)
    assert (command.velocity, command.effort) == pytest.approx((-MODEL.velocity, MODEL.effort))
    assert (gains.stiffness, gains.damping) == (500.0, 5.0)


def read(frames):
    return [decode(frame, MODEL) for frame in frames]


def test_ready_frames():
    assert read(limp_frames(22, MODEL)) == [Gains(22, 0.0, 0.0), Gains(22, 0.0, 0.0), Command(22, 0.0, 0.0, 0.0)]
    assert read(damping_frames(22, MODEL, 2.0)) == [
        Gains(22, 0.0, 2.0),
        Gains(22, 0.0, 2.0),
        Command(22, 0.0, 0.0, 0.0),
    ]
    assert read(damping_frames(22, MODEL, 50.0))[0] == Gains(22, 0.0, 5.0), "within what is ever tried"
    assert read(reset_frames(22, MODEL))[-1] == Reset(22)
    assert read(reset_frames(22, MODEL))[:3] == read(limp_frames(22, MODEL)), "limp first, should it not obey"
