"""Pause, speed, push and reset of a session that runs, as a page asks for them; its recordings replay."""

import shutil
import time

from loaded_session import LONG, playing
from play_fixtures import quick_robot

from humanoid_sim import replay
from humanoid_sim.cli import run_program
from humanoid_sim.messages import Event, EventKind, Mode, TickRecord
from humanoid_sim.recording.reader import open_recording


def entries(path):
    recording = open_recording(path)
    found = list(recording.entries())
    assert recording.is_complete
    return [one for one in found if isinstance(one, TickRecord)], [one for one in found if isinstance(one, Event)]


def test_a_simulation_is_paused_paced_pushed_and_reset(folder, capfd, run):
    robot = quick_robot(folder, "lite_biped")
    with playing(folder, "--policy", "placeholder", "--pace", "realtime", "--robot", robot) as session:
        ask = session.intake.ask

        def now():
            return float(session.tick()["time"])

        assert ask("damp", LONG).granted
        assert ask("pause", LONG).granted
        session.until(lambda: session.feed.status()["simulation"]["paused"])
        stood, number = now(), session.feed.newest()
        session.until(lambda: session.feed.newest() > number + 20)  # what stands still is shown as it is
        assert now() == stood
        assert ask("load_a", LONG).text.endswith("the robot's time is paused; resume, look, and ask again")
        assert ask("damp", LONG).granted
        session.until(lambda: now() > stood)
        assert now() < stood + 0.03  # the tick of DAMP
        assert ask("speed 0.1", LONG).granted
        assert ask("resume", LONG).granted
        begun, stood = time.monotonic(), now()
        session.until(lambda: now() > stood + 0.1)
        assert time.monotonic() - begun > 0.5
        assert ask("speed 4", LONG).granted
        session.stand()
        assert ask("push 0.5,0", LONG).granted
        session.until(lambda: now() > stood + 1.0)
        assert ask("pause", LONG).granted
        assert ask("reset", LONG).granted  # which ends the pause
        session.until(lambda: session.tick()["mode"] == Mode.ZERO_TORQUE)
        session.stand()
        assert ask("damp", LONG).granted
        assert ask("quit", LONG).granted
        session.process.wait(LONG)
    capfd.readouterr()
    for name in ("r.mcap", "r-2.mcap"):
        assert run_program(replay.main, [name]) == 0
        assert "bit for bit identical\n" in capfd.readouterr().out
        assert name in (folder / "out.txt").read_text()
    ticks, events = entries("r.mcap")
    (push,) = (event for event in events if event.kind is EventKind.PUSH)
    assert push.text.startswith("pushed by 0.5,0 m/s; requested by test (")
    assert (events[-1].text, events[-1].kind) == ("ending: reset", EventKind.ENDING)
    later, _ = entries("r-2.mcap")
    for some in (ticks, later):
        assert [tick.index for tick in some] == list(range(len(some)))
    assert float(later[0].input.state.time) > float(ticks[-1].input.state.time)
    # Both go on in a branch: the second by its own clock, the first up to the push.
    for name in ("r.mcap", "r-2.mcap"):
        shutil.move(folder / name, folder / f"of-{name}")
    before = next(tick for tick in ticks if float(tick.input.state.time) > push.time - 0.002)
    for name, at in (("of-r-2.mcap", later[-60]), ("of-r.mcap", before)):
        first = run("--branch", f"{name}@{at.input.state.time}", "--duration", "0.1").ticks[0]
        assert (first.input.state.time, first.qpos.tobytes()) == (at.input.state.time, at.qpos.tobytes())
    refused = run("--branch", f"of-r.mcap@{push.time + 0.1:g}")
    assert "has a push of an operator at" in refused.err
