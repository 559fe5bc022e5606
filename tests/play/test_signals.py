"""Signals to a real process in mid-motion."""

import fcntl
import os
import pty
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from waiting import until

from humanoid_sim import mode, replay
from humanoid_sim.cli import run_program
from humanoid_sim.client import Feed, running_sessions
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Mode, TickRecord
from humanoid_sim.play.console import PlayConsole
from humanoid_sim.play.options import PlayConfig
from humanoid_sim.play.run import bring_up
from humanoid_sim.recording.reader import open_recording

SCRIPT = "damp; load_a; wait; start_locomotion; hold 60"
PLACEHOLDER = ("--policy", "placeholder")  # which loads no network
OPTIONS = (*PLACEHOLDER, "--pace", "realtime")


def usual_signals():
    """Undo what the test runner may have inherited: a job in the background ignores SIGINT, one under nohup SIGHUP."""
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


PLAY = (sys.executable, "-m", "humanoid_sim.play", "--viewer", "none", "--record", "r.mcap")


@contextmanager
def playing(folder, *options, stdin=None, stdout=subprocess.PIPE, stderr=subprocess.STDOUT):
    """A process that plays and records into `r.mcap`; killed at the end if it still runs."""
    with subprocess.Popen(
        [*PLAY, *options],
        cwd=folder,
        stdin=stdin,
        stdout=stdout,
        stderr=stderr,
        text=True,
        preexec_fn=usual_signals,  # noqa: PLW1509 - no thread of the tests runs here
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def wait_for(process, text):
    """The output up to a line that holds `text`."""
    seen = ""
    for line in process.stdout:
        seen += line
        if text in line:
            return seen
    raise AssertionError(f"{text!r} never came:\n{seen}")


def finished(process):
    out, _ = process.communicate(timeout=120.0)
    return out


@pytest.fixture
def hanging(make_robot):
    """A robot whose pose A lets the arms hang: at the end they are soon at rest."""

    def hang(document):
        document["standby_controller_a"]["pose_segments"] = [document["initial_position"]] * 2

    return make_robot(change=hang)


def recorded(folder):
    recording = open_recording(folder / "r.mcap")
    entries = list(recording.entries())
    assert recording.is_complete
    ticks = [entry for entry in entries if isinstance(entry, TickRecord)]
    assert [tick.index for tick in ticks] == list(range(len(ticks)))
    return ticks, [entry.text for entry in entries if not isinstance(entry, TickRecord)]


@pytest.mark.parametrize(
    ("number", "status"), [(signal.SIGINT, 130), pytest.param(signal.SIGTERM, 143, marks=pytest.mark.soak)]
)
def test_a_signal_in_motion_ends_through_damping(number, status, folder, hanging):
    with playing(folder, "--robot", hanging, "--script", SCRIPT, *OPTIONS) as process:
        wait_for(process, "STANDBY → LOCOMOTION")
        time.sleep(0.1)
        process.send_signal(number)
        out = finished(process)
    assert process.returncode == status
    assert f"ending: {number.name}" in out
    assert "Traceback" not in out
    assert "LOCOMOTION → DAMPING" in out
    ticks, events = recorded(folder)
    assert events == [f"ending: {number.name}"]
    modes = [tick.output.control_mode.mode for tick in ticks]
    first = modes.index(Mode.DAMPING, modes.index(Mode.LOCOMOTION))
    assert set(modes[first:]) == {Mode.DAMPING}
    assert len(modes) - first > 100  # half a second of rest at the least
    assert ticks[-1].output.quit
    assert run_program(replay.main, ["r.mcap"]) == 0


def test_a_second_signal_does_not_wait_for_the_arms_to_rest(folder, quick):
    with playing(folder, "--robot", quick, "--script", SCRIPT, *OPTIONS) as process:
        wait_for(process, "STANDBY → LOCOMOTION")
        process.send_signal(signal.SIGINT)
        wait_for(process, "LOCOMOTION → DAMPING")
        process.send_signal(signal.SIGINT)
        finished(process)
    assert process.returncode == 130
    ticks, _ = recorded(folder)
    modes = [tick.output.control_mode.mode for tick in ticks]
    assert 1 <= len(modes) - modes.index(Mode.DAMPING, modes.index(Mode.LOCOMOTION)) < 100  # 0.5 s
    assert ticks[-1].output.quit


@pytest.mark.soak
def test_a_signal_without_torque_ends_at_once(folder, quick):
    with playing(folder, "--robot", quick, "--script", "hold 60", *OPTIONS) as process:
        wait_for(process, "ZERO_TORQUE")
        process.send_signal(signal.SIGHUP)  # the terminal was closed
        finished(process)
    assert process.returncode == 129
    ticks, _ = recorded(folder)
    assert {tick.output.control_mode.mode for tick in ticks} == {Mode.ZERO_TORQUE}


@pytest.mark.soak
def test_a_run_under_nohup_outlives_its_terminal(folder, quick):
    code = (
        "import signal, sys; signal.signal(signal.SIGHUP, signal.SIG_IGN); from humanoid_sim.play import main; "
        f"sys.exit(main(['--robot', {quick!r}, '--script', 'hold 1', '--pace', 'realtime', '--viewer', 'none', "
        "'--record', 'none', '--policy', 'placeholder']))"
    )
    with subprocess.Popen([sys.executable, "-c", code], cwd=folder, stdout=subprocess.PIPE, text=True) as process:
        wait_for(process, "ZERO_TORQUE")
        process.send_signal(signal.SIGHUP)
        out = finished(process)
    assert process.returncode == 0
    assert "ending: script finished" in out


@pytest.mark.soak
def test_the_keyboard_drives_a_run(folder, quick):
    master, slave = pty.openpty()
    try:
        with playing(folder, "--robot", quick, "--manual", *PLACEHOLDER, stdin=slave) as process:
            os.close(slave)
            out = wait_for(process, "started")
            assert "keys: space or d DAMP, a LOAD_A" in out
            for key, mode in (("d", "DAMPING"), ("\x1b[A", ""), ("b", "STANDBY"), (" ", "STANDBY → DAMPING")):
                os.write(master, key.encode())
                if mode:
                    wait_for(process, mode)
                else:
                    time.sleep(0.1)
            os.write(master, b"q")
            finished(process)
    finally:
        os.close(master)
    assert process.returncode == 0
    ticks, events = recorded(folder)
    assert events == ["ending: QUIT"]
    controllers = [tick.output.control_mode.controller_name for tick in ticks]
    assert list(dict.fromkeys(controllers)) == ["zero_torque_controller", "damping_controller", "standby_controller_b"]
    assert ticks[-1].output.quit


@pytest.mark.soak
def test_an_operator_in_another_terminal_takes_over(folder, quick, capfd):
    def ask(word, status=0):
        assert run_program(mode.main, [word, "--session", str(process.pid)]) == status
        return capfd.readouterr().out.partition("): ")[2]

    with playing(folder, "--robot", quick, "--script", "damp; hold 60; load_a", *OPTIONS) as process:
        wait_for(process, "DAMPING")
        assert ask("load_b").startswith("STANDBY (standby_controller_b): LOAD_B requested")
        assert "QUIT refused: requires ZERO_TORQUE or DAMPING, mode is STANDBY" in ask("quit", status=1)
        assert ask("damp").startswith("DAMPING")
        ask("quit")
        finished(process)
    assert process.returncode == 0


@pytest.mark.soak
def test_a_reader_that_leaves_does_not_stop_the_run(folder, quick):
    with playing(folder, "--robot", quick, "--script", "damp; hold 0.5", "--summary", "s.json", *OPTIONS) as process:
        wait_for(process, "DAMPING")
        process.stdout.close()
        process.wait(timeout=30.0)
    assert process.returncode == 0
    ticks, events = recorded(folder)
    assert events == ["ending: script finished"]
    assert ticks[-1].output.quit
    assert (folder / "s.json").is_file()


@pytest.mark.soak
def test_a_reader_that_is_gone_before_anything_is_printed_does_not_keep_a_run_from_running(folder, quick):
    read, write = os.pipe()
    os.close(read)
    command = [*PLAY, "--robot", quick, "--script", "damp; hold 0.2", *PLACEHOLDER]
    run = subprocess.run(command, cwd=folder, stdout=write, stderr=subprocess.PIPE, text=True, check=False)
    os.close(write)
    assert (run.returncode, run.stderr) == (0, "")
    ticks, _ = recorded(folder)
    assert ticks[-1].output.quit


def test_a_question_that_nobody_reads_enables_nothing(monkeypatch):
    class Asking:
        question = "Enable?"

        def prepare(self): ...

        def checks(self):
            return [("ok", "can0", "all there")]

    console = PlayConsole()
    console.is_unread = True
    monkeypatch.setattr("sys.stdin", type("Terminal", (), {"isatty": lambda _: True})())
    with pytest.raises(InputError, match="--yes: is needed where the question cannot be read"):
        bring_up(Asking(), PlayConfig(hardware="can0"), console)


@pytest.mark.soak
def test_an_output_that_is_full_is_noticed_before_anything_moves(folder, quick):
    command = [*PLAY, "--robot", quick]
    with Path("/dev/full").open("w") as full:
        run = subprocess.run(command, cwd=folder, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert (run.returncode, run.stderr) == (1, "error: standard output cannot be written: No space left on device\n")
    assert not (folder / "r.mcap").exists()


@pytest.mark.soak
def test_an_output_that_fails_in_mid_run_does_not_stop_it(folder, quick):
    """`ulimit -f` lets files grow to 1 KiB only; a recording would not fit either."""
    options = f"--viewer none --record none --robot {quick} --script 'damp; hold 0.5; load_a; hold 0.2' --pace fast"
    line = f"trap '' XFSZ; ulimit -f 1; exec {sys.executable} -B -m humanoid_sim.play {options} --summary s.json >> out"
    (folder / "out").write_text(" " * 900, encoding="utf-8")
    run = subprocess.run(["bash", "-c", line], cwd=folder, stderr=subprocess.PIPE, text=True, check=False)
    assert "Traceback" not in run.stderr
    assert run.returncode == 1
    assert "File too large" in run.stderr


@pytest.mark.soak
def test_an_output_that_fails_after_the_run_is_one_line(folder, quick):
    line = f"""import os, sys; from humanoid_sim.cli import run_program; from humanoid_sim.play import main, run
before = run.print_report
def report(*arguments):
    os.dup2(os.open("/dev/full", os.O_WRONLY), 1)
    before(*arguments)
run.print_report = report
options = ["--viewer", "none", "--record", "none", "--summary", "s.json", "--html", "p.html", "--script", "hold 0.1"]
sys.exit(run_program(main, [*options, "--policy", "placeholder", "--robot", {quick!r}]))"""
    run = subprocess.run([sys.executable, "-c", line], cwd=folder, capture_output=True, text=True, check=False)
    assert run.returncode == 1
    assert run.stderr == "failed: standard output cannot be written: No space left on device\n"
    assert (folder / "s.json").is_file()
    assert (folder / "p.html").is_file()


@contextmanager
def unread(folder, *options):
    """A process that plays into a pipe that nobody reads, with room for the introduction but not for the run."""
    read, write = os.pipe()
    size = fcntl.fcntl(write, fcntl.F_SETPIPE_SZ, 4096)
    os.write(write, b" " * (size - 1500))
    try:
        with playing(folder, *options, stdout=write, stderr=subprocess.PIPE) as process:
            yield process
    finally:
        os.close(read)
        os.close(write)


def running(process):
    """Its session, once others can find it."""
    assert process.poll() is None
    return next((session for session in running_sessions() if session.process == process.pid), None)


CHATTER = "; ".join(["damp", "hold 0.05", "load_a", "hold 0.05"] * 20)


@pytest.mark.soak
def test_a_pipe_that_nobody_reads_does_not_keep_a_run_from_ending(folder, quick):
    options = ("--robot", quick, "--script", CHATTER, "--pace", "fast", "--summary", "s.json")
    with unread(folder, *options) as process:
        _, err = process.communicate(timeout=120.0)
    assert process.returncode == 1
    assert err == "failed: console: did not finish within 5 s\n"
    assert len(recorded(folder)[1]) == 1
    assert (folder / "s.json").is_file()


@pytest.mark.soak
def test_a_signal_after_the_robot_is_closed_ends_the_process(folder, quick):
    options = ("--robot", quick, "--script", f"{CHATTER}; hold 60", "--pace", "realtime")
    with unread(folder, *options) as process:
        session = until(lambda: running(process))
        with Feed(session) as feed:

            def has_said_all():
                tick = feed.latest()
                return tick is not None and feed.decode(tick)["time"] > 3.0

            until(has_said_all)
        process.send_signal(signal.SIGINT)
        process.send_signal(signal.SIGINT)  # does not wait for rest
        until(lambda: not Path(session.intents).exists())  # closed after the robot; the console is yet to close
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=120.0)
    assert process.returncode in (130, -signal.SIGINT)  # by itself, or by one signal more as Python ends
    assert "did not finish" not in err
    assert "Traceback" not in err
