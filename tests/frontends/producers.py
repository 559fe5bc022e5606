"""Programs that command a run from outside: what they send, how they are lost, and a gamepad."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass

import pytest
from fates import PATIENCE, Played, available

CLIENT = """
import sys, time
from humanoid_sim.client import *
session = find_session(int(sys.argv[1]))
with Feed(session) as feed, Intake(session, "client") as intake:
    names, number = feed.joint_names, 0
    zeros = [0.0] * len(names)
    print("ready", flush=True)
    while feed.is_running():
        sample = feed.wait(number, 0.5)
        if sample is None:
            continue
        number = sample.number
        try:
            {send}
        except SessionError:
            break
"""
DDS_CLIENT = """
import numpy as np
from humanoid_sim.dds_client import RobotClient
from humanoid_sim.mit import MITCommand
with RobotClient() as client:
    while client.state(60.0) is None:
        pass
    zeros = np.zeros(len(client.joint_names))
    print("ready", flush=True)
    while client.state() is not None:
        client.command(MITCommand(zeros, zeros, zeros + 0.125, zeros, zeros + 1.0))
"""
"""A program that commands REMOTE as any on DDS does."""
SENDS = {
    "remote": "intake.remote(names, zeros, zeros, [0.125] * len(names), zeros, [1.0] * len(names), stamp=sample.stamp)",
    "velocity": "intake.velocity(0.5, 0.0, 0.0, deliberate=True)",
}
"""What a program does in every tick that has no more than the client module."""


@contextmanager
def client(play: Played, kind: str) -> Iterator[subprocess.Popen[str]]:
    """That program, or the one on DDS, once it is attached."""
    program = DDS_CLIENT if kind == "dds" else CLIENT.format(send=SENDS[kind])
    command = [sys.executable, "-c", program, str(play.process.pid)]
    environment = {**os.environ, "ROS_DOMAIN_ID": str(play.domain)}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        try:
            assert process.stdout.readline() == "ready\n"
            yield process
        finally:
            process.kill()


@dataclass(frozen=True)
class Producer:
    """Who commands in REMOTE, and which of its processes is lost."""

    owner: str
    """As which it owns REMOTE."""
    front_end: str = ""
    """That `play` starts."""
    program: str = ""
    """That is started beside it, a kind of `client`."""
    loses_program: bool = False
    """The program is lost, not the front end."""

    def lose(self, play: Played, blow: signal.Signals) -> None:
        """Strike as soon as it commands, and wait for the end of the run."""
        with client(play, self.program) if self.program else nullcontext() as process:
            play.until_owned("REMOTE", self.owner)
            if self.loses_program:
                process.send_signal(blow)
                play.operator.ask("mark blow")
            else:
                play.strike([self.front_end], blow)
            play.process.wait(PATIENCE)


PRODUCERS = {
    "gravity": Producer("gravity", front_end="gravity"),
    "client": Producer("client", program="remote", loses_program=True),
    "DDS client": Producer("dds", front_end="dds", program="dds", loses_program=True),
    "DDS bridge": Producer("dds", front_end="dds", program="dds"),
}
"""A front end of this package, a program that has the client module alone, and both ends of DDS."""


def skip_unless_installed(producer: Producer) -> None:
    if producer.front_end and not available([producer.front_end]):
        pytest.skip(f"the packages of {producer.front_end} are not installed")
