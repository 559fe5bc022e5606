"""A DAMP during a flood of both sockets, each in a process of its own."""

import os
import subprocess
import sys
import threading
import time

import pytest

from humanoid_sim.client import Feed, Intake, running_sessions

pytestmark = pytest.mark.soak

FLOOD = """
import sys, time
from humanoid_sim.client import *
session = find_session(int(sys.argv[1]))
with Intake(session, "flood") as intake:
    intake._data.setblocking(False)
    intake._intents.setblocking(False)
    print("ready", flush=True)
    begin, count = time.monotonic(), 0
    try:
        while True:
            intake.velocity(1.0, 0.0, 0.0, deliberate=True)
            count += 1
            if count % 10:
                continue
            try:  # its answers are never taken
                intake._intents.sendto(b"mark flood\\nflood (1)\\n1", session.intents)
            except BlockingIOError:
                pass
    except (SessionError, OSError):
        print(round(count / (time.monotonic() - begin)), flush=True)
"""
DAMP = 0
"""In a tick's `intents`."""


def test_a_damp_sent_during_a_flood_of_10_khz_acts_in_the_next_tick(run, quick):
    late = []
    rates = []
    refusals = []

    def operate():
        while not (sessions := running_sessions()):
            time.sleep(0.01)
        with Feed(sessions[0]) as feed, Intake(sessions[0], "operator") as operator:
            while not feed.newest():
                time.sleep(0.01)
            command = [sys.executable, "-c", FLOOD, str(os.getpid())]
            before = feed.latest().stamp
            with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as flood:
                flood.stdout.readline()
                for _ in range(10):
                    time.sleep(0.05)
                    token = operator.post("damp")
                    sent = feed.newest()  # the tick after this one may have looked before the DAMP was sent
                    assert operator.answer(token, 5.0).granted
                    acted = [n.number for n in feed.since(sent - 1) if DAMP in feed.decode(n)["intents"]]
                    late.append(acted[0] - sent)
                stale = operator.ask("load_a", 5.0, seen=before)
                refusals.append(stale.text)
                operator.ask("quit")
                rates.append(int(flood.stdout.readline()))

    thread = threading.Thread(target=operate)
    thread.start()
    result = run("--robot", quick, "--policy", "placeholder", "--script", "hold 60", "--pace", "realtime")
    thread.join()
    assert result.status == 0
    assert rates[0] > 10_000
    assert len(late) == 10
    assert max(late) <= 2
    assert refusals[0].startswith("LOAD_A refused: too late, it was meant for the robot of ")
