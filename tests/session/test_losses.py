"""The operator's device, and the process's own time."""

import pytest
import rig

from humanoid_sim.messages import Intent
from humanoid_sim.session.losses import DeviceWatch, Interruption


class Watched:
    def __init__(self):
        self.heard = {}
        self.told = []
        self.watch = DeviceWatch("gamepad", lambda: self.heard, self.told.append)
        self.run = rig.Run(rig.supervisor())
        self.output = None

    def tick(self, *intents):
        found = tuple(self.watch.poll(self.run.time, self.output))
        self.output = self.run.step(*intents, *found)
        return found

    def heartbeat(self):
        self.heard["gamepad"] = self.run.time


@pytest.fixture
def watched():
    return Watched()


def test_heartbeats_that_waited_while_motors_were_enabled_are_no_loss(watched):
    watched.heartbeat()
    watched.run.time += 7.0
    assert watched.tick() == ()
    watched.heartbeat()
    watched.run.time += 7.0  # enabled afresh
    assert watched.tick() == ()
    silent = watched.run.time
    while not watched.tick():
        assert watched.run.time - silent < 0.3
    assert watched.told == ["gamepad: lost, no heartbeat for 0.2 s: DAMP"]
    watched.run.time += 7.0
    watched.tick()
    assert watched.told == ["gamepad: lost, no heartbeat for 0.2 s: DAMP"], "nor is one that is lost there again by it"


def test_a_suspension_is_refused_without_telling_anybody_in_the_handler():
    """What is told takes locks that the interrupted thread may hold."""
    told = []
    interruption = Interruption(0.1, told.append, clock=lambda: 0.0)
    interruption.refuse_suspension()
    assert not told
    assert interruption.poll(0.0, None) == (Intent.DAMP,)
    assert len(told) == 1
    assert interruption.poll(0.0, None) == ()
