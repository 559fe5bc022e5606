"""Every front end stopped and killed in every mode, on emulated motors."""

import time
from contextlib import nullcontext

import pytest
from fates import BLOWS, ROWS, display, on_motors, playing, skip_unless, watchers
from producers import PRODUCERS, skip_unless_installed, virtual_pad

from humanoid_sim.client import monotonic_ns
from humanoid_sim.messages import Intent, Mode

pytestmark = pytest.mark.soak

PERIOD = 0.02
"""s"""
TOO_LATE = 0.035
"""s between two ticks: nearly one is missing, and such a run says nothing."""
ATTEMPTS = 4
CONTROLLERS = {
    Mode.ZERO_TORQUE: "zero_torque_controller",
    Mode.DAMPING: "damping_controller",
    Mode.STANDBY: "standby_controller_a",
    Mode.LOCOMOTION: "rl_policy_controller",
    Mode.REMOTE: "remote_policy_controller",
}
WAY = {
    Mode.ZERO_TORQUE: (Mode.ZERO_TORQUE,),
    Mode.DAMPING: (Mode.ZERO_TORQUE, Mode.DAMPING),
    Mode.STANDBY: (Mode.ZERO_TORQUE, Mode.DAMPING, Mode.STANDBY),
    Mode.LOCOMOTION: (Mode.ZERO_TORQUE, Mode.DAMPING, Mode.STANDBY, Mode.LOCOMOTION),
    Mode.REMOTE: (Mode.ZERO_TORQUE, Mode.DAMPING, Mode.STANDBY, Mode.REMOTE),
}


def course(mode):
    """Modes and controllers of a run that nothing disturbs."""
    modes = WAY[mode] if mode is Mode.DAMPING else (*WAY[mode], Mode.DAMPING)
    return [(mode, CONTROLLERS[mode]) for mode in modes]


def struck(folder, mode, names, blow, *, on_display=True):
    """A run with these front ends on a machine that was in time, which was in that mode when the blow fell."""
    asked = [option for name in names for option in ROWS[name].options]
    problem = ""
    with display() if on_display else nullcontext((None, "")) as (_, screen):
        for _ in range(ATTEMPTS):
            with playing(folder, *on_motors(folder, mode, *asked), screen=screen) as play:
                play.reach(mode)
                blow(play)
                log = play.finish()
            problem = disturbance(log) or ("" if log.mode_at(log.blow) is mode else "the mode was over before the blow")
            if not problem:
                assert log.status == 0, play.said
                return log
    pytest.fail(f"the machine is too busy: {problem}", pytrace=False)


def disturbance(log):
    """How the machine itself was late; empty: it was not."""
    return f"{log.longest_pause():.3f} s between ticks" if log.longest_pause() > TOO_LATE else ""


def check_frames(log):
    """Every motor got every tick's command, and answered."""
    hardware = log.summary["hardware"]
    assert hardware["commanded"] == hardware["acknowledged"] >= 14 * len(log.ticks)
    assert (hardware["invalid_frames"], hardware["refused"], log.summary["safety"]) == (0, 0, [])
    indices = [tick.index for tick in log.ticks]
    assert indices == list(range(len(indices)))


@pytest.mark.parametrize("blow", BLOWS)
@pytest.mark.parametrize("mode", Mode, ids=lambda mode: mode.name)
@pytest.mark.parametrize("alone", ["", *(name for name in ROWS if ROWS[name].instead)])
def test_those_who_look_on_change_neither_mode_nor_controller_nor_frames(alone, mode, blow, folder, rows, request):
    """All at once, and a producer for REMOTE in the modes in which it does not command; or one that is not a window."""
    skip_unless((mode, blow) == (Mode.LOCOMOTION, "killed" if alone else "stopped"), request)
    names = watchers(alone, mode, [name for name in ROWS if not ROWS[name].operates])
    log = struck(folder, mode, names, lambda play: play.strike(names, BLOWS[blow]), on_display=not alone)
    assert log.ended == (dict.fromkeys(names, "-9") if blow == "killed" else {})
    assert log.course == course(mode)
    check_frames(log)
    assert log.is_exact()
    rows += [(name, blow, mode.name, "motors", f"{14 * len(log.ticks)} frames, none missing") for name in names]


@pytest.mark.parametrize("blow", BLOWS)
@pytest.mark.parametrize("name", PRODUCERS)
def test_a_producer_for_remote_leaves_the_robot_passive_within_100_ms(name, blow, folder, rows, request):
    skip_unless((name, blow) in {("gravity", "killed"), ("DDS bridge", "stopped")}, request)
    skip_unless_installed(PRODUCERS[name])
    log = struck(
        folder,
        Mode.REMOTE,
        [PRODUCERS[name].front_end] if PRODUCERS[name].front_end else [],
        lambda play: PRODUCERS[name].lose(play, BLOWS[blow]),
    )
    took = log.silence()
    assert 0.1 - PERIOD <= took <= 0.1 + PERIOD + 1e-3
    assert log.course == course(Mode.REMOTE), "passive is REMOTE still"
    check_frames(log)
    assert log.is_exact()
    rows.append((name, blow, "REMOTE", "motors", f"passive {1e3 * took:.0f} ms after its last command"))


def unplug(pad):
    pad.stdin.write("unplug\n")
    pad.stdin.flush()


LOSSES = {
    "unplugged": unplug,
    "killed": lambda pad: pad.send_signal(BLOWS["killed"]),
    "stopped": lambda pad: pad.send_signal(BLOWS["stopped"]),
}


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("mode", Mode, ids=lambda mode: mode.name)
def test_the_loss_of_the_gamepad_damps_in_every_mode(mode, loss, folder, rows, request):
    """Within 200 ms and a tick; at once where its program lives to tell."""
    pytest.importorskip("pygame", reason="pygame-ce is not installed (extra 'gamepad')")
    skip_unless(mode is Mode.LOCOMOTION or (mode, loss) == (Mode.ZERO_TORQUE, "killed"), request)
    problem = ""
    for _ in range(ATTEMPTS):
        problem, took, log = damped_after(folder, mode, loss)
        if not problem:
            break
    else:
        pytest.fail(f"the machine is too busy: {problem}", pytrace=False)
    assert took <= (0.1 if loss == "unplugged" else 0.2) + 0.05
    assert (
        log.course == [*((mode, CONTROLLERS[mode]) for mode in WAY[mode]), *course(Mode.DAMPING)[1:]][: len(log.course)]
    )
    assert log.course[-1][0] is Mode.DAMPING
    check_frames(log)
    assert log.is_exact()
    rows.append(("gamepad", loss, mode.name, "motors", f"DAMP after {1e3 * took:.0f} ms"))


def damped_after(folder, mode, loss):
    """How the machine was late, if it was; s from the loss to the tick with the DAMP; and the run."""
    options = on_motors(folder, mode, *ROWS["gamepad"].options, lead=3.0)
    with playing(folder, *options) as play, virtual_pad(play) as pad:
        is_there = play.reach(mode, 20.0)  # a pad whose program gets no time is lost on its way
        time.sleep(0.4)
        begun = monotonic_ns()
        LOSSES[loss](pad)
        time.sleep(0.6)
        stamps = {sample.number - 1: sample.stamp for sample in play.feed.since(0)}
        play.process.terminate()
        log = play.finish()
    if not is_there:
        return "the gamepad was lost before", 0.0, log
    damps = [tick.index for tick in log.ticks if Intent.DAMP in tick.input.intents]
    damp = next((index for index in damps if stamps.get(index, 0) > begun), None)
    before = log.ticks[damp - 1 if damp else 0].output.control_mode.mode
    if damp is None or before is not mode:
        problem = disturbance(log) or "the gamepad was lost before"
        assert damp is not None or problem, "no DAMP"
        return problem, 0.0, log
    return disturbance(log), 1e-9 * (stamps[damp] - begun), log
