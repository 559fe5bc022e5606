"""An operator is obeyed, and whoever falls silent moves nothing: signals, terminal, other programs, through `play`."""

import os
import pty
import signal
import time
from contextlib import contextmanager
from subprocess import DEVNULL

import numpy as np
import pytest
from session_surface import (
    Conditions,
    OtherProgram,
    joint_names,
    play,
    playing,
    quick_policy,
    quick_robot,
    reach,
    read_ticks,
)

from humanoid_sim.messages import Intent, Mode, SafetyLevel
from humanoid_sim.mit import MITCommand

PLACEHOLDER = ("--policy", "placeholder")
REST = 100
"""Ticks in half a second of simulation."""


def until(condition):
    """Wait for a tick, as part of an operator."""
    while True:
        tick = yield
        if condition(tick):
            return tick


def mode_is(mode):
    return lambda tick: tick.output.control_mode.mode is mode


def pass_ticks(count):
    for _ in range(count):
        tick = yield
    return tick


def mode_after(tick):
    return tick.output.control_mode.mode


def standby_finished(tick):
    return tick.output.standby is not None and tick.output.standby.is_finished


def send(*numbers):
    for number in numbers:
        os.kill(os.getpid(), number)


def check_damped_to_the_end(run, mode, at_least=REST, at_most=10**6):
    """After the last tick in a mode only finite commands without a spring or torque, and a whole recording."""
    last = len(run.modes) - 1 - run.modes[::-1].index(mode)
    after = run.ticks[last + 1 :]
    assert at_least <= len(after) <= at_most
    for tick in after:
        command = tick.output.command
        assert tick.output.control_mode.mode is Mode.DAMPING
        assert command.is_finite()
        assert not command.stiffness.any()
        assert not command.effort.any()
        assert (command.damping > 0.0).all()
    assert after[-1].output.quit
    assert run.is_complete


# Signals.

WALK = "damp; load_a; wait; start_locomotion; hold 60"
SIGNALS = {
    "SIGINT": (signal.SIGINT,),
    "SIGTERM": (signal.SIGTERM,),
    "SIGHUP, of a terminal that is closed": (signal.SIGHUP,),
    "SIGQUIT": (signal.SIGQUIT,),
}


@pytest.mark.parametrize("name", SIGNALS)
def test_a_signal_in_motion_ends_the_run_through_damping_and_is_its_exit_status(name, quick):
    def operator():
        yield from until(mode_is(Mode.LOCOMOTION))
        send(*SIGNALS[name])

    run = play("--robot", quick, *PLACEHOLDER, "--script", WALK, operator=operator())
    assert run.status == 128 + SIGNALS[name][0]
    check_damped_to_the_end(run, Mode.LOCOMOTION)


def test_a_second_ctrl_c_hurries_and_two_signals_at_once_end_the_run(quick):
    def hurried():
        yield from until(mode_is(Mode.LOCOMOTION))
        send(signal.SIGINT)
        yield from until(mode_is(Mode.DAMPING))
        yield from pass_ticks(10)
        send(signal.SIGINT)

    run = play("--robot", quick, *PLACEHOLDER, "--script", WALK, operator=hurried())
    assert run.status == 130
    check_damped_to_the_end(run, Mode.LOCOMOTION, 10, 15)

    def at_once():
        yield from until(mode_is(Mode.LOCOMOTION))
        send(signal.SIGINT, signal.SIGTERM)

    run = play("--robot", quick, *PLACEHOLDER, "--script", WALK, operator=at_once())
    assert run.status in (130, 143)
    check_damped_to_the_end(run, Mode.LOCOMOTION, 1, 3)


def test_in_simulation_ctrl_z_suspends_the_process_and_it_goes_on_afterwards(quick):
    options = ("--robot", quick, *PLACEHOLDER, "--script", "damp; load_a; hold 60", "--pace", "realtime")
    with playing(*options, process_group=0, stdin=DEVNULL, stdout=DEVNULL, stderr=DEVNULL) as process:
        reach(process, Mode.STANDBY)
        process.send_signal(signal.SIGTSTP)
        _, status = os.waitpid(process.pid, os.WUNTRACED)
        assert os.WIFSTOPPED(status)
        process.send_signal(signal.SIGCONT)
        reach(process, Mode.STANDBY)
        process.send_signal(signal.SIGINT)
        assert process.wait(60.0) == 130
    ticks, is_complete = read_ticks("r.mcap")
    assert ticks[-1].output.control_mode.mode is Mode.DAMPING
    assert is_complete


# The terminal.


class Terminal:
    """A pseudo-terminal; `stdin` is this process's end of it."""

    def __init__(self, master, stdin):
        self.master, self.stdin = master, stdin

    def type(self, text):
        os.write(self.master, text.encode())

    def hang_up(self):
        os.close(self.master)
        self.master = None


@contextmanager
def terminal():
    master, slave = pty.openpty()
    with os.fdopen(slave) as stdin:
        found = Terminal(master, stdin)
        try:
            yield found
        finally:
            if found.master is not None:
                found.hang_up()


def typed(end, key, condition):
    """Type a key again and again until a tick is as expected, as part of an operator; that tick."""
    for count in range(10**6):
        if count % 100 == 0:
            end.type(key)
        tick = yield
        if condition(tick):
            return tick
        time.sleep(0.001)  # the keyboard may be read on a thread


MANUAL = ("--manual", "--pace", "fast", "--duration", "60")


def test_a_terminal_that_is_lost_damps_and_the_run_goes_on(quick):
    def operator(end):
        yield from typed(end, "d", mode_is(Mode.DAMPING))
        yield from typed(end, "a", mode_is(Mode.STANDBY))
        end.hang_up()
        for _ in range(10**6):
            tick = yield
            if mode_is(Mode.DAMPING)(tick):
                break
            time.sleep(0.001)
        yield from pass_ticks(20)
        send(signal.SIGTERM)

    with terminal() as end:
        run = play("--robot", quick, *PLACEHOLDER, *MANUAL, operator=operator(end), stdin=end.stdin)
    assert run.status == 143
    check_damped_to_the_end(run, Mode.STANDBY)


LEADS_TO = {"A": ("b", "standby_controller_b"), "B": ("a", "standby_controller_a")}
"""Letter that escape sequences hold, and the key of the other pose, which shows that they were read."""


@pytest.mark.parametrize("letter", LEADS_TO)
def test_arrow_keys_and_other_escape_sequences_are_no_intents_however_they_are_cut(letter, quick):
    key, controller = LEADS_TO[letter]
    keys = (letter.lower(), "l", "r", "q", "e")
    sequences = [f"\x1b[{letter}", f"\x1bO{letter}", f"\x1b[1;2{letter}", *(f"\x1b{key}" for key in keys), "\x1b[3~"]

    def operator(end):
        yield from typed(end, "d", mode_is(Mode.DAMPING))
        for sequence in sequences:
            for piece in (sequence, *sequence):
                end.type(piece)
                for _ in range(3):
                    yield
                    time.sleep(0.001)
        tick = yield from typed(end, key, lambda tick: not mode_is(Mode.DAMPING)(tick))
        assert tick.output.control_mode.controller_name == controller
        yield from typed(end, " ", mode_is(Mode.DAMPING))
        yield from typed(end, "q", lambda tick: tick.output.quit)

    with terminal() as end:
        controllers = {"zero_torque_controller", "damping_controller", controller}
        run = play("--robot", quick, *PLACEHOLDER, *MANUAL, operator=operator(end), stdin=end.stdin)
    assert {"zero_torque_controller", *(tick.output.control_mode.controller_name for tick in run.ticks)} == controllers
    assert run.status == 0


def test_a_process_that_holds_motors_refuses_to_be_suspended_and_a_lost_terminal_damps_it(quick):
    master, slave = pty.openpty()
    options = ("--robot", quick, *PLACEHOLDER, "--hardware", "virtual:held", "--manual")
    with playing(*options, process_group=0, stdin=slave, stdout=DEVNULL, stderr=DEVNULL) as process:
        os.close(slave)

        def typing(keys):
            return lambda: os.write(master, keys)

        reach(process, Mode.DAMPING, typing(b"d"))
        reach(process, Mode.STANDBY, typing(b"a"))
        process.send_signal(signal.SIGTSTP)
        reach(process, Mode.DAMPING)
        reach(process, Mode.STANDBY, typing(b"a"))
        os.close(master)
        reach(process, Mode.DAMPING)
        process.send_signal(signal.SIGHUP)
        assert process.wait(60.0) == 128 + signal.SIGHUP
    ticks, is_complete = read_ticks("r.mcap")
    assert ticks[-1].output.control_mode.mode is Mode.DAMPING
    assert ticks[-1].output.quit
    assert is_complete


# Other programs.


def linked(*arguments, operator, around=None):
    """A run that other programs drive; nobody types at its terminal."""
    with terminal() as end:
        return play(*arguments, *MANUAL, operator=operator, stdin=end.stdin, around=around)


def led_to_standby(program):
    program.ask(Intent.DAMP)
    yield from until(mode_is(Mode.DAMPING))
    program.ask(Intent.LOAD_A)
    return (yield from until(standby_finished))


def test_a_safety_status_of_another_program_damps_until_its_own_source_clears_it(quick):
    def operator():
        yield
        with OtherProgram() as program:
            yield from led_to_standby(program)
            program.report("lidar", SafetyLevel.FAULT)
            assert mode_after((yield from pass_ticks(1))) is Mode.DAMPING
            program.report("door", SafetyLevel.FAULT)
            yield
            program.report("door", SafetyLevel.OK)
            program.ask(Intent.LOAD_A)
            assert mode_after((yield from pass_ticks(3))) is Mode.DAMPING, "another source's OK clears nothing"
            program.report("lidar", SafetyLevel.OK)
            assert mode_after((yield from pass_ticks(3))) is Mode.DAMPING, "and nothing recovers by itself"
            program.ask(Intent.LOAD_A)
            assert mode_after((yield from pass_ticks(1))) is Mode.STANDBY
        send(signal.SIGTERM)

    run = linked("--robot", quick, *PLACEHOLDER, operator=operator())
    assert run.status == 143


def test_a_watchdog_whose_source_is_silent_damps(quick):
    around = Conditions()

    def operator():
        yield
        with OtherProgram() as program:
            program.ask(Intent.DAMP)
            yield from until(mode_is(Mode.DAMPING))
            program.ask(Intent.LOAD_A)
            assert mode_after((yield from pass_ticks(3))) is Mode.DAMPING, "it has not reported yet"
            program.report("lidar", SafetyLevel.OK)
            yield
            program.ask(Intent.LOAD_A)
            yield from until(standby_finished)
            around.aged += 590.0
            assert mode_after((yield from pass_ticks(2))) is Mode.STANDBY
            around.aged += 11.0
            assert mode_after((yield from pass_ticks(1))) is Mode.DAMPING
        send(signal.SIGTERM)

    linked("--robot", quick, *PLACEHOLDER, "--watchdog", "lidar:600", operator=operator(), around=around)


def test_a_policy_waits_for_its_live_input_and_stops_when_it_falls_silent(quick, tmp_path):
    policy = quick_policy(tmp_path, {"name": "foot_contact", "width": 2, "timeout": 0.2}, 2)

    def operator():
        yield
        with OtherProgram() as program:
            yield from led_to_standby(program)
            program.ask(Intent.START_LOCOMOTION)
            assert mode_after((yield from pass_ticks(3))) is Mode.STANDBY
            program.live("foot_contact", [1.0, 0.0])
            yield
            program.ask(Intent.START_LOCOMOTION)
            start = yield from until(mode_is(Mode.LOCOMOTION))
            stop = yield from until(mode_is(Mode.DAMPING))
            assert 0.1 < float(stop.input.state.time - start.input.state.time) < 0.3
        send(signal.SIGTERM)

    run = linked("--robot", quick, "--policy", policy, operator=operator())
    seen = [tick.output.policy_step.observation[-2:].tolist() for tick in run.ticks if tick.output.policy_step]
    assert seen
    assert all(values == [1.0, 0.0] for values in seen), "never zeros, and never an old value"


def test_a_velocity_command_that_is_not_repeated_becomes_zero(quick, tmp_path):
    policy = quick_policy(tmp_path, "velocity_commands", 3)

    def operator():
        yield
        with OtherProgram() as program:
            yield from led_to_standby(program)
            program.ask(Intent.START_LOCOMOTION)
            yield from until(mode_is(Mode.LOCOMOTION))
            for _ in range(100):
                program.velocity(0.5, 0.0, -0.2)
                yield
            yield from pass_ticks(100)
        send(signal.SIGTERM)

    run = linked("--robot", quick, "--policy", policy, operator=operator())
    steps = [tick for tick in run.ticks if tick.output.policy_step]
    seen = [tick.output.policy_step.observation[-3:].tolist() for tick in steps]
    commanded = [step for step, values in zip(steps, seen, strict=True) if any(values)]
    np.testing.assert_allclose(seen[20], [0.5, 0.0, -0.2], rtol=1e-6)
    lasted = float(commanded[-1].input.state.time - commanded[0].input.state.time)
    assert 0.5 < lasted < 0.5 + 0.3, "as long as it was sent, and 0.25 s"
    assert not any(seen[-1])
    assert steps[-1].output.control_mode.mode is Mode.LOCOMOTION, "the policy goes on, with zero"


def test_remote_on_a_floating_base_needs_commands_that_already_arrive(quick, tmp_path):
    biped = quick_robot(tmp_path, "lite_biped")

    def operator():
        tick = yield
        n = tick.output.command.joint_count
        hold = MITCommand(tick.input.state.joint_position, *np.zeros((2, n)), np.full(n, 20.0), np.ones(n))
        with OtherProgram() as program:
            yield from led_to_standby(program)
            program.ask(Intent.START_REMOTE)
            assert mode_after((yield from pass_ticks(3))) is Mode.STANDBY
            program.remote(joint_names(biped), hold)
            yield
            program.ask(Intent.START_REMOTE)
            assert mode_after((yield from pass_ticks(1))) is Mode.REMOTE
        send(signal.SIGTERM)

    linked("--robot", biped, *PLACEHOLDER, operator=operator())
