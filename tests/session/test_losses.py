"""The operator's device, and the process's own time."""

import rig

from humanoid_sim.messages import Intent
from humanoid_sim.session.losses import DeviceWatch, Interruption


def test_heartbeats_that_waited_while_motors_were_enabled_are_no_loss():
    heartbeats, told, outputs, run = {}, [], [None], rig.Run(rig.supervisor())
    watch = DeviceWatch("gamepad", lambda: heartbeats, told.append)

    def tick():
        found = tuple(watch.poll(run.time, outputs[-1]))
        outputs.append(run.step(*found))
        return found

    for _ in range(2):
        heartbeats["gamepad"] = run.time
        run.time += 7.0  # enabled, and afresh
        assert tick() == ()
    silent = run.time
    while not tick():
        assert run.time - silent < 0.3
    assert told == ["gamepad: lost, no heartbeat for 0.2 s: DAMP"]
    run.time += 7.0
    tick()
    assert len(told) == 1, "nor is one that is lost there again by it"


def test_a_suspension_is_refused_without_a_line_in_the_handler():
    """A line takes locks that the interrupted thread may hold."""
    told = []
    interruption = Interruption(0.1, told.append, clock=lambda: 0.0)
    interruption.refuse_suspension()
    assert not told
    assert interruption.poll(0.0, None) == (Intent.DAMP,)
    assert len(told) == 1
    assert interruption.poll(0.0, None) == ()
