import os
import socket

import numpy as np
import pytest
import rig

from humanoid_sim.client import monotonic_ns

ME = f"({os.getpid()})"


def send(intake, value=0.5):
    """A remote command whose positions are all `value`."""
    assert intake.remote(rig.JOINTS, [value] * 3, [0.0] * 3, [0.0] * 3, [40.0] * 3, [4.0] * 3)


def value_of(record):
    """Of the command in force in REMOTE; None where the joints are damped."""
    command = record.output.command
    return float(command.position[0]) if command.stiffness.any() else None


def test_remote_belongs_to_the_first_producer_after_activation_until_it_is_stale(local):
    first, second = local.intake("first"), local.intake("second")
    send(second, 0.9)  # before REMOTE: it claims nothing
    local.enter_remote()
    assert value_of(local.tick()) is None
    for _ in range(3):
        send(first, 0.1)
        send(second, 0.2)
        assert value_of(local.tick()) == 0.1
    assert f"REMOTE: belongs to first {ME}" in local.told
    assert local.told.count(f"refused of second {ME}: REMOTE: belongs to first {ME}") == 1
    stopped = local.robot.time
    while local.robot.time - stopped < 0.1 - 1.5 * rig.PERIOD:  # a sample is as old as its way was long
        send(second, 0.2)
        assert value_of(local.tick()) == 0.1
    while value_of(local.tick()) is not None:
        pass
    assert local.robot.time - stopped <= 0.1 + rig.PERIOD + 1e-9
    assert local.data.owners["REMOTE"] == ""
    send(second, 0.2)
    assert value_of(local.tick()) == 0.2
    assert local.told[-1] == f"REMOTE: belongs to second {ME}"


def test_what_is_not_accepted_is_refused_by_name(local):
    intake = local.intake("wrong")
    for name, refusal in (
        ("pedals", "live input 'pedals' is not observed; the policy observes: keys, pose"),
        ("keys", "live input 'keys': has 1 values, expected 2, all finite"),
    ):
        intake.live(name, [1.0])
        local.tick()
        assert local.told[-1].startswith(f"refused of wrong {ME}: {refusal}")
    with pytest.raises(ValueError, match="expected 3 values in each field"):
        intake.remote(rig.JOINTS, [0.0], *[[0.0] * 3] * 4)


def test_a_velocity_belongs_to_the_producer_that_last_changed_it_deliberately(local):
    stick, page = local.intake("gamepad"), local.intake("console")

    def tick():
        state = local.tick().input.state
        return state.extern["velocity_command"].at(state.time).tolist(), local.data.owners["velocity"]

    stick.velocity(0.0, 0.0, 0.0, deliberate=False)
    assert tick() == ([0.0, 0.0, 0.0], "")
    page.velocity(0.4, 0.0, 0.1, deliberate=True)
    assert tick() == ([0.4, 0.0, 0.1], f"console {ME}")
    stick.velocity(0.0, 0.0, 0.0, deliberate=False)  # a stick at rest claims nothing
    page.velocity(0.4, 0.0, 0.1, deliberate=False)  # repeated, because it is still meant
    assert tick() == ([0.4, 0.0, 0.1], f"console {ME}")
    stick.velocity(-0.2, 0.0, 0.0, deliberate=True)
    page.velocity(0.4, 0.0, 0.1, deliberate=False)
    assert tick() == ([-0.2, 0.0, 0.0], f"gamepad {ME}")
    assert f"refused of console {ME}: velocity: belongs to gamepad {ME}" in local.told
    local.velocity.press("w")
    stick.velocity(-0.2, 0.0, 0.0, deliberate=False)
    assert tick() == ([-0.1, 0.0, 0.0], "keyboard")


def test_live_inputs_reach_the_state_and_expire(local):
    midi = local.intake("midi")

    def tick():
        state = local.tick().input.state
        return state.extern["keys"].at(state.time).tolist()

    midi.live("keys", [0.0, 1.0])
    midi.live("keys", [1.0, 0.0])
    assert tick() == [1.0, 0.0], "the newest"
    midi.live("pose", [1.0])
    assert [tick() for _ in range(100)][20::79] == [[1.0, 0.0], [0.0, 0.0]]
    state = local.tick().input.state
    assert state.extern["pose"].at(state.time).tolist() == [1.0], "its contract says that it does not grow old"


def test_random_datagrams_do_nothing_worse_than_being_refused(local):
    generator = np.random.default_rng(7)
    words = ("remote a\tb", "velocity", "live keys", "heartbeat", "live")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as client:
        client.setblocking(False)
        for i in range(3000):
            data = generator.bytes(int(generator.integers(0, 300)))
            if i % 4 == 0:
                data = f"{words[i // 4 % 5]}\nme\n\n{monotonic_ns()}\n".encode() + data
            try:
                client.sendto(data, str(local.registration.path / ("data", "intents")[i % 2]))
            except BlockingIOError:
                local.tick()
    record = local.tick()
    assert record.output.control_mode.controller_name == "zero_torque_controller"
    assert record.input.remote is None
    assert set(record.input.state.extern) <= {"velocity_command", "keys", "pose"}
