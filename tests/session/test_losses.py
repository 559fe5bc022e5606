import os
import pty
import signal
import subprocess
import sys
import time

import pytest
import rig

from humanoid_sim.session.losses import DeviceWatch

CHILD = """
import time
from humanoid_sim.messages import Intent, Mode, TickInput, TickOutput
from humanoid_sim.session.keyboard import Keyboard
keyboard, heard, deadline = Keyboard(), [], time.monotonic() + 20.0
print("ready", flush=True)
while Intent.QUIT not in heard and time.monotonic() < deadline:
    heard += keyboard.poll(0.0, None)
    time.sleep(0.005)
keyboard.close()
print(*(intent.name for intent in heard))
"""


@pytest.mark.soak
def test_keys_typed_while_the_process_was_stopped_only_damp():
    """What was meant for a shell moves nothing."""
    master, slave = pty.openpty()
    command = [sys.executable, "-c", CHILD]
    with subprocess.Popen(command, stdin=slave, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout.readline() == "ready\n"
        os.write(master, b"b")
        time.sleep(0.3)
        child.send_signal(signal.SIGSTOP)
        time.sleep(0.5)
        os.write(master, b"la a")
        child.send_signal(signal.SIGCONT)
        time.sleep(0.5)
        os.write(master, b"rq")
        assert child.stdout.readline().split() == ["LOAD_B", "DAMP", "START_REMOTE", "QUIT"]
    os.close(master)
    os.close(slave)


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

    def beat(self):
        self.heard["gamepad"] = self.run.time


@pytest.fixture
def watched():
    return Watched()


def test_heartbeats_that_waited_while_motors_were_enabled_are_no_loss(watched):
    watched.beat()
    watched.run.time += 7.0
    assert watched.tick() == ()
    watched.beat()
    watched.run.time += 7.0  # enabled afresh
    assert watched.tick() == ()
    silent = watched.run.time
    while not watched.tick():
        assert watched.run.time - silent < 0.3
    assert watched.told == ["gamepad: lost, nothing heard for 0.2 s: DAMP"]
    watched.run.time += 7.0
    watched.tick()
    assert watched.told == ["gamepad: lost, nothing heard for 0.2 s: DAMP"], "nor is one that is lost there again by it"
