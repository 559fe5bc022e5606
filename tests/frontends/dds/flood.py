"""A client that floods, as a program: `python flood.py DOMAIN JOINTS RATE`, until it is killed. Every fifth command is
one for the robot; the others are wrong each in its way."""

import sys
import time

from cyclonedds._clayer import ddspy_write
from stranger import client, command, until

_BATCH = 0.002
"""s between two bursts."""


def main(domain: int, joints: list[str], rate: float) -> None:
    count = len(joints)
    samples = (
        command(joints, 0.1),
        command(joints[::-1], 0.1),
        command(joints, float("nan")),
        command(joints, 0.1, velocity=[0.0] * (count + 1)),
        command([*joints[1:], "x" * 20_000], 0.1),
    )
    messages = [sample.serialize() for sample in samples]
    messages = [message.ljust(-(-len(message) // 4) * 4, b"\0") for message in messages]
    with client(domain) as joined:
        writer = joined.writer("rt/remote_policy_controller/command")
        until(writer.get_matched_subscriptions, "somebody to flood", 120.0)
        begun, sent = time.monotonic(), 0
        while True:
            while sent < rate * (time.monotonic() - begun):
                ddspy_write(writer._ref, messages[sent % len(messages)])
                sent += 1
            time.sleep(_BATCH)


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2].split(","), float(sys.argv[3]))
