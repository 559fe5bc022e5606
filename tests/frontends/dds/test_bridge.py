"""The bridge as a program, by clients that know nothing of this project."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed (dds)")

import rig
from dds_bridge import bridge
from local_session import LocalSession, ticking
from stranger import Client, client, command, newest, until

from humanoid_sim.messages import Mode, TickRecord

COMMAND = "rt/remote_policy_controller/command"


@pytest.fixture
def cyclone(domain: int) -> Iterator[Client]:
    with client(domain) as joined:
        yield joined


def mode_of(records: list[TickRecord]) -> Mode:
    return records[-1].output.control_mode.mode


def test_a_stranger_sees_the_robot_and_commands_it(local: LocalSession, cyclone: Client) -> None:
    with bridge() as process:
        local.enter_remote()
        with ticking(local, rig.PERIOD) as records:
            joint_states = newest(cyclone.reader("rt/three/joint_states"))
            assert joint_states.name == ["shoulder", "elbow", "wrist"]
            assert joint_states.position == [0.4, 0.5, 0.6]
            control_mode = newest(cyclone.reader("rt/control_mode"))
            assert (control_mode.mode, control_mode.controller_name) == (4, "remote_policy_controller")
            writer = cyclone.writer(COMMAND)
            until(writer.get_matched_subscriptions, "the bridge's subscription")

            def obeyed() -> bool:
                writer.write(command(rig.JOINTS, 0.25))
                time.sleep(0.01)
                return records[-1].output.command.position.tolist() == [0.25] * 3

            until(obeyed, "the command")
            assert records[-1].output.command.stiffness.tolist() == [20.0] * 3
            assert local.data.owners["REMOTE"].startswith("dds ")
        local.feed.close()
        assert process.wait(10.0) == 0
