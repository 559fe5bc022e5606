from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from humanoid_sim.messages import ControlMode, Mode, SessionHeader, TickInput, TickOutput, TickRecord
from humanoid_sim.mit import FloatArray, MITCommand, MITState, mit_torque
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.session.gravity_source import GravityForm, GravitySource, gravity_command
from humanoid_sim.session.sources import RemoteInbox
from humanoid_sim.simulation.kinematics import GravityTorque


@pytest.fixture(scope="module")
def lite() -> RobotDescription:
    return load_robot("lite")


@pytest.fixture(scope="module")
def pose(lite: RobotDescription) -> FloatArray:
    return np.array(lite.standby_controller_a.pose_segments[-1])


def state(position: FloatArray, time: float = 0.0) -> MITState:
    return replace(MITState.unknown(len(position), time), joint_position=position)


def record(position: FloatArray, *, remote: bool, time: float = 0.0) -> TickRecord:
    name, mode = ("remote_policy_controller", Mode.REMOTE) if remote else ("damping_controller", Mode.DAMPING)
    output = TickOutput(MITCommand.zeros(len(position)), ControlMode(mode, name))
    return TickRecord(0, TickInput(state(position, time)), output, 0.0, False)


@pytest.mark.parametrize("form", ["effort", "pd"])
def test_both_forms_hold_the_pose_at_rest(lite: RobotDescription, pose: FloatArray, form: GravityForm) -> None:
    gravity = GravityTorque(lite)(pose)
    assert np.abs(gravity).max() > 1.0  # there is something to hold
    command = gravity_command(lite, pose, gravity, form)
    torque = mit_torque(command, pose, np.zeros(len(pose)), lite.effort_limit)
    np.testing.assert_allclose(torque, gravity, atol=1e-12)
    assert not command.velocity.any()
    assert bool(command.stiffness.any()) == (form == "pd")
    assert bool(command.effort.any()) == (form == "effort")
    assert (command.damping > 0.0).all()


def heard(inbox: RemoteInbox, after: MITCommand | None = None) -> MITCommand:
    """The latest command, once it is another than `after`."""
    deadline = time.monotonic() + 5.0
    while True:
        latest = inbox.latest()
        if latest is not None and latest.command is not after:
            return latest.command
        assert time.monotonic() < deadline
        time.sleep(0.001)


class Source:
    """A running gravity source and its inbox."""

    def __init__(self, description: RobotDescription, form: GravityForm = "effort") -> None:
        self.inbox = RemoteInbox(description.joint_names, lambda: 0.0)
        self.source = GravitySource(description, self.inbox, form)

    def __enter__(self) -> Source:
        self.source.start(SessionHeader("lite", (), 0.005, 0))
        return self

    def __exit__(self, *_: Any) -> None:
        self.source.close()

    def after(self, tick: TickRecord) -> MITCommand:
        """The second command after a tick: the first may have been under way."""
        self.source.tick(tick)
        return heard(self.inbox, heard(self.inbox, heard(self.inbox)))


def test_the_effort_form_compensates_whatever_pose_the_arms_are_in(lite: RobotDescription, pose: FloatArray) -> None:
    gravity = GravityTorque(lite)
    with Source(lite) as running:
        for position in (pose, 0.5 * pose):
            command = running.after(record(position, remote=True))
            assert command.position.tolist() == position.tolist()
            assert command.effort.tolist() == gravity(position).tolist()
        assert running.source.error is None
        assert running.source.backlog == 0


def test_the_pd_form_holds_the_first_pose_of_each_stay_in_remote(lite: RobotDescription, pose: FloatArray) -> None:
    def expected(position: FloatArray) -> FloatArray:
        return position + GravityTorque(lite)(position) / lite.stiffness

    with Source(lite, "pd") as running:
        for tick, held in (
            (record(0.9 * pose, remote=False), 0.9 * pose),
            (record(pose, remote=True), pose),
            (record(0.8 * pose, remote=True), pose),  # pushed away: it pulls back
            (record(0.7 * pose, remote=False), 0.7 * pose),
            (record(0.6 * pose, remote=True), 0.6 * pose),
        ):
            assert running.after(tick).position.tolist() == expected(held).tolist()


def test_a_state_that_is_not_known_sends_nothing(lite: RobotDescription, pose: FloatArray) -> None:
    unknown = pose.copy()
    unknown[3] = np.nan
    with Source(lite) as running:
        running.source.tick(record(unknown, remote=True))
        time.sleep(0.05)
        assert running.inbox.latest() is None
        running.after(record(pose, remote=True))


def test_a_source_that_fails_falls_silent_and_says_why(lite: RobotDescription, pose: FloatArray) -> None:
    with Source(lite) as running:
        running.source.tick(record(pose[:5], remote=True))
        deadline = time.monotonic() + 5.0
        while running.source.error is None and time.monotonic() < deadline:
            time.sleep(0.001)
    assert isinstance(running.source.error, ValueError)
    assert running.inbox.accepted == 0


def test_one_that_was_never_started_can_be_closed(lite: RobotDescription) -> None:
    Source(lite).source.close()
