"""Every front end stopped and killed in every mode of a simulated run: whoever only looks on changes nothing."""

import tempfile
from contextlib import nullcontext
from functools import cache

import pytest
from fates import BLOWS, ROWS, available, display, playing, script, skip_unless, walking_lite, watchers
from play_fixtures import quick_robot
from producers import PRODUCERS, client, skip_unless_installed

from humanoid_sim.cli import FRONT_ENDS
from humanoid_sim.messages import Mode
from humanoid_sim.mit import VELOCITY_COMMAND

SAMPLE = {(Mode.STANDBY, "stopped"), (Mode.LOCOMOTION, "killed")}
"""Modes and blows that are tried without --complete."""
ATTEMPTS = 4
"""On a machine that is so busy that the blow falls after the mode."""
PERIOD = 0.005
"""s"""


def test_every_front_end_has_a_row():
    started = {name: front_end.option for name, front_end in FRONT_ENDS.items() if front_end.option}
    assert {name: row.options[0] for name, row in ROWS.items()} == started, "add its row: what may its loss cost?"


def simulated(folder, mode, *options, policy="placeholder"):
    """Options of `play` for a run through that mode in real time."""
    given = ("--robot", quick_robot(folder), "--policy", policy, "--script", script(mode))
    return *given, "--pace", "realtime", *options


@pytest.fixture(scope="module")
def unwatched(tmp_path_factory):
    """The control log of a run that nobody watched."""

    @cache
    def run(mode):
        folder = tmp_path_factory.mktemp("unwatched")
        with pytest.MonkeyPatch.context() as patch, tempfile.TemporaryDirectory(prefix="hs-") as runtime:
            patch.setenv("XDG_RUNTIME_DIR", runtime)
            with playing(folder, *simulated(folder, mode)) as play:
                log = play.finish()
        assert log.status == 0, play.said
        return log.control()

    return run


def struck(folder, mode, names, blow, *, on_display=True, **given):
    """A run with these front ends, which was in that mode when the blow fell."""
    with display() if on_display else nullcontext((None, "")) as (_, screen):
        asked = [option for name in names for option in ROWS[name].options]
        for _ in range(ATTEMPTS):
            with playing(folder, *simulated(folder, mode, *asked, **given), screen=screen) as play:
                play.reach(mode)
                blow(play)
                log = play.finish()
            assert log.status == 0, play.said
            if log.mode_at(log.blow) is mode:
                return log
    pytest.fail("the machine is too busy: the mode was over before the blow fell", pytrace=False)


@pytest.mark.soak
@pytest.mark.parametrize("blow", BLOWS)
@pytest.mark.parametrize("mode", Mode, ids=lambda mode: mode.name)
@pytest.mark.parametrize("alone", ["", *(name for name in ROWS if ROWS[name].instead)])
def test_those_who_look_on_leave_the_control_log_as_it_is(alone, mode, blow, unwatched, folder, rows, request):
    """All at once, and a producer for REMOTE in the modes in which it does not command; or one that is not a window."""
    skip_unless((mode, blow) in SAMPLE, request)
    names = watchers(alone, mode, ROWS)
    log = struck(folder, mode, names, lambda play: play.strike(names, BLOWS[blow]), on_display=not alone)
    assert log.ended == (dict.fromkeys(names, "-9") if blow == "killed" else {})
    assert log.control() == unwatched(mode)
    assert log.is_exact()
    rows += [(name, blow, mode.name, "simulated", f"{len(log.ticks)} ticks, bit for bit") for name in names]


@pytest.mark.soak
def test_a_window_whose_display_is_lost_leaves_the_control_log_as_it_is(unwatched, folder, rows):
    names = [name for name in available(ROWS) if ROWS[name].window]
    if not names:
        pytest.skip("Xvfb is not installed (xvfb)")
    mode = Mode.LOCOMOTION
    options = simulated(folder, mode, *ROWS["viewer"].options)
    with display() as (server, screen), playing(folder, *options, screen=screen) as play:
        play.reach(mode)
        server.kill()
        play.operator.ask("mark blow")
        log = play.finish()
    assert log.status == 0, play.said
    assert log.mode_at(log.blow) is mode
    assert log.ended == {"viewer": "1"}
    assert log.control() == unwatched(mode)
    assert log.is_exact()
    rows.append(("viewer", "display lost", mode.name, "simulated", f"{len(log.ticks)} ticks, bit for bit"))


def velocity(tick):
    """Shape (3,), as the policy observes it."""
    state = tick.input.state
    return state.extern[VELOCITY_COMMAND].at(state.time)


@pytest.mark.soak
@pytest.mark.parametrize("blow", BLOWS)
@pytest.mark.parametrize("name", PRODUCERS)
def test_a_producer_for_remote_leaves_the_robot_passive_within_100_ms(name, blow, folder, rows, request):
    is_sampled = (blow == "stopped") is PRODUCERS[name].loses_program
    skip_unless(is_sampled, request)
    skip_unless_installed(PRODUCERS[name])
    log = struck(
        folder,
        Mode.REMOTE,
        [PRODUCERS[name].front_end] if PRODUCERS[name].front_end else [],
        lambda play: PRODUCERS[name].lose(play, BLOWS[blow]),
    )
    took = log.silence()
    assert 0.1 - PERIOD <= took <= 0.1 + PERIOD + 1e-6
    assert log.is_exact()
    rows.append((name, blow, "REMOTE", "simulated", f"passive {1e3 * took:.0f} ms after its last command"))


@pytest.mark.soak
@pytest.mark.parametrize("blow", BLOWS)
@pytest.mark.parametrize("mode", Mode, ids=lambda mode: mode.name)
def test_what_a_lost_source_of_velocity_commanded_is_zero_within_its_timeout(mode, blow, folder, rows, request):
    skip_unless((mode, blow) == (Mode.LOCOMOTION, "killed"), request)

    def strike(play):
        with client(play, "velocity") as process:
            play.until_owned("velocity", "client")
            process.send_signal(BLOWS[blow])
            play.operator.ask("mark blow")
            play.process.wait()

    log = struck(folder, mode, [], strike, policy=walking_lite(folder))
    heard = [tick for tick in log.ticks if velocity(tick).any()]
    assert velocity(heard[0]).tolist() == [0.5, 0.0, 0.0]
    arrival = heard[-1].input.state.extern[VELOCITY_COMMAND].arrival_time
    after = next(tick for tick in log.ticks if tick.index > heard[-1].index)
    took = float(after.input.state.time) - arrival
    assert 0.25 - PERIOD <= took <= 0.25 + PERIOD + 1e-6
    assert log.is_exact()
    rows.append(("velocity source", blow, mode.name, "simulated", f"zero {1e3 * took:.0f} ms after its last command"))
