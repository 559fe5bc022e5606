import numpy as np
import pytest
from drive import Drive

from humanoid_sim.gravity import gravity_command
from humanoid_sim.messages import Intent, Mode, RemoteCommand
from humanoid_sim.simulation.kinematics import GravityTorque


class Compensation:
    """What the gravity front end sends, one command per tick and late by one, without its process."""

    def __init__(self, drive, form):
        self._drive = drive
        self._form = form
        self._gravity = GravityTorque(drive.description)
        self._held = None

    def __call__(self):
        drive = self._drive
        self._held = drive.position if self._held is None or self._form == "effort" else self._held
        command = gravity_command(drive.description, self._held, self._gravity(self._held), self._form)
        return RemoteCommand(command, drive.time)


def in_remote():
    drive = Drive(remote=True)
    drive.stand()
    drive.run(0.5)
    assert drive.step(Intent.START_REMOTE).control_mode.mode is Mode.REMOTE
    return drive


@pytest.mark.parametrize(("form", "drift"), [("effort", 0.01), ("pd", 0.002)])
def test_gravity_compensation_holds_the_arms_still(form, drift):
    drive = in_remote()
    start = drive.position
    drive.run(5.0, Compensation(drive, form))
    assert drive.outputs[-1].control_mode.mode is Mode.REMOTE
    assert np.abs(drive.position - start).max() < drift  # rad in 5 s
    assert np.abs(drive.states[-1].joint_velocity).max() < 0.001
    assert np.abs(drive.applied()[-1]).max() > 1.0


def test_the_effort_form_lets_the_arms_be_moved_and_the_pd_form_pulls_back():
    moved = {}
    for form in ("effort", "pd"):
        drive = in_remote()
        source = Compensation(drive, form)
        drive.run(0.5, source)
        start = drive.position
        elbow = drive.robot.model.body("left_elbow_pitch").id
        drive.robot.data.xfrc_applied[elbow, 0] = 10.0  # N, forward, for half a second
        drive.run(0.5, source)
        drive.robot.data.xfrc_applied[:] = 0.0
        drive.run(1.5, source)
        moved[form] = float(np.abs(drive.position - start).max())
    assert moved["effort"] > 0.1
    assert moved["pd"] < 0.005


@pytest.mark.parametrize("form", ["effort", "pd"])
def test_a_source_that_falls_silent_lets_the_arms_sink_damped(form):
    drive = in_remote()
    drive.run(1.0, Compensation(drive, form))
    last = Compensation(drive, form)()
    silent = len(drive.states)
    drive.run(1.0, lambda: last)  # the same old command, as an inbox keeps it
    for i in range(silent, len(drive.states)):
        command, age = drive.outputs[i].command, float(drive.states[i].time) - last.arrival_time
        if age <= 0.1:
            assert command is last.command
        else:
            assert command.damping.tolist() == [5.0] * 14
            assert not command.stiffness.any()
            assert not command.effort.any()
            assert command.position.tolist() == drive.states[i].joint_position.tolist()
    assert drive.outputs[-1].control_mode.mode is Mode.REMOTE
    fastest = max(np.abs(state.joint_velocity).max() for state in drive.states[silent:])
    assert 0.05 < fastest < 1.0  # they sink, and slowly
