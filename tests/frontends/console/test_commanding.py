"""What pages command, tick by tick, on a session without a loop; the clock is the test's own."""

import os
from dataclasses import dataclass

import msgspec
import pytest
import rig
from local_session import LocalSession

from humanoid_sim.client import Feed
from humanoid_sim.errors import FieldError
from humanoid_sim.frontends.attach import Attachment
from humanoid_sim.frontends.console.commanding import Commanding
from humanoid_sim.frontends.console.sliders import Goals
from humanoid_sim.frontends.console.turn import Steering
from humanoid_sim.frontends.console.wishes import Beat, LetGo, Press, Snap, Steer, Take
from humanoid_sim.messages import Intent, Mode, SessionHeader, TickRecord
from humanoid_sim.robots.description import load_robot

NAME = f"console ({os.getpid()})"
N = len(rig.JOINTS)


def robot():
    """The rig's three joints as a robot, made of the Lite's first three."""
    lite = load_robot("lite")
    replace = msgspec.structs.replace
    joints = tuple(replace(joint, name=name) for joint, name in zip(lite.joints, rig.JOINTS, strict=False))
    a, b = (
        replace(
            each,
            target_stiffness=each.target_stiffness[:N],
            target_damping=each.target_damping[:N],
            pose_segments=tuple(pose[:N] for pose in each.pose_segments),
        )
        for each in (lite.standby_controller_a, lite.standby_controller_b)
    )
    changed = replace(lite, joints=joints, initial_position=(0.0,) * N, standby_controller_a=a, standby_controller_b=b)
    return changed.to_json()


@dataclass
class Desk:
    """A console's commanding on a session, both driven a period at a time."""

    local: LocalSession
    commanding: Commanding
    time: list[int]
    """ns, CLOCK_MONOTONIC."""
    record: TickRecord

    def turn(self, seconds=rig.PERIOD, *, page=1, goals=None, seen=0.0):
        """The page beats, the console sends, the session ticks; what the page shows is `seen` s old."""
        for _ in range(round(seconds / rig.PERIOD)):
            self.time[0] += int(1e9 * rig.PERIOD)
            if page is not None:
                told = self.commanding.told(self.record)
                number = told["sliders"]["number"] if told["sliders"] else 0
                self.commanding.hear(page, Beat(told["sent"] - seen, number, goals))
            self.commanding.step()
            self.tick()

    def tick(self, *intents):
        self.record = self.local.tick(*intents)
        self.commanding.look(self.record)
        self.local.feed.status(self.local.data.status())

    @property
    def stiffness(self):
        return [round(value, 3) for value in self.record.output.command.stiffness.tolist()]

    @property
    def is_passive(self):
        """Damped, and nothing else: by REMOTE itself, or by the console's last command."""
        command = self.record.output.command
        return not command.stiffness.any() and not command.effort.any() and min(command.damping.tolist()) >= 5.0

    @property
    def text(self):
        return str(self.commanding.told(self.record)["let_go"])

    @property
    def moves(self):
        return self.commanding.told(self.record)["sliders"] is not None


@pytest.fixture
def desk(local, monkeypatch):
    time = [10**12]
    monkeypatch.setattr("humanoid_sim.client.monotonic_ns", lambda: time[0])
    local.publish(SessionHeader("three", rig.JOINTS, rig.PERIOD, 0, {"robot": robot()}), robot="three")
    with Feed(local.info) as feed:
        attachment = Attachment(local.info, feed, local.intake("console"))
        commanding = Commanding(attachment, lambda: time[0])
        try:
            yield Desk(local, commanding, time, local.tick())
        finally:
            commanding.close()


@pytest.fixture
def remote(desk):
    desk.local.enter_remote()
    desk.tick()
    return desk


def test_it_takes_over_and_moves_the_joint(remote):
    assert remote.is_passive
    remote.commanding.hear(1, Take("elbow"))
    remote.turn()
    assert not remote.is_passive
    assert remote.stiffness == [1.0, 0.0, 1.0]
    assert remote.record.output.command.position.tolist() == list(rig.KNOWN)
    remote.turn(2.0, goals=Goals(0.7, 0.5, 1.0, 40.0, 2.0))
    command = remote.record.output.command
    assert remote.stiffness == [50.0, 40.0, 50.0]
    assert command.position.tolist() == pytest.approx([0.4, 0.5 + 7.0 / 40.0, 0.6])
    assert (command.velocity[1], command.effort[1], command.damping[1]) == (0.5, 1.0, 2.0)
    assert remote.local.data.owners["REMOTE"] == NAME
    told = remote.commanding.told(remote.record)["sliders"]
    assert (told["page"], told["joint"], told["measured"]) == (1, "elbow", 0.5)
    assert told["goals"] == {"position": 0.7, "velocity": 0.5, "effort": 1.0, "stiffness": 40.0, "damping": 2.0}


def test_it_needs_remote(desk):
    desk.tick(Intent.DAMP)
    with pytest.raises(FieldError, match="sliders: require REMOTE; mode is DAMPING"):
        desk.commanding.hear(1, Take("elbow"))


def test_an_unknown_joint_is_refused(remote):
    with pytest.raises(FieldError, match="unknown joint 'nose'"):
        remote.commanding.hear(1, Take("nose"))
    assert not remote.moves


@pytest.mark.parametrize("silence", [0.48, 0.54])
def test_without_the_pages_heart_it_lets_go_after_half_a_second(remote, silence):
    remote.commanding.hear(1, Take("elbow"))
    remote.turn(1.0)
    remote.turn(silence, page=None)
    assert remote.is_passive == (silence > 0.5)
    assert remote.moves == (silence < 0.5)
    if silence > 0.5:
        assert remote.text == "sliders let go: page 1 was not heard for 0.5 s"
        remote.turn(1.0, goals=Goals(0.7, stiffness=40.0))  # heard again: nothing begins by itself
        assert remote.is_passive


def test_a_page_that_closes_or_lets_go_ends_it_in_the_next_tick(remote):
    for leaves in (lambda: remote.commanding.leave(1), lambda: remote.commanding.hear(1, LetGo())):
        remote.commanding.hear(1, Take("elbow"))
        remote.turn(1.0)
        assert not remote.is_passive
        leaves()
        remote.turn()
        assert remote.is_passive
        assert remote.record.output.command.damping.tolist() == [5.0] * N  # the console's last command
        remote.turn(0.12)
        assert remote.record.output.command.damping.tolist() == rig.PASSIVE_KD  # REMOTE's own hold


def test_a_second_page_is_told_who_moves_what(remote):
    remote.commanding.hear(1, Take("elbow"))
    remote.turn()
    with pytest.raises(FieldError, match="sliders: page 1 moves elbow"):
        remote.commanding.hear(2, Take("wrist"))
    with pytest.raises(FieldError, match="sliders: this page does not move a joint"):
        remote.commanding.hear(2, Snap())
    remote.commanding.hear(2, LetGo())
    remote.commanding.leave(2)
    remote.turn()
    assert remote.moves
    remote.commanding.hear(1, LetGo())
    remote.commanding.hear(2, Take("wrist"))
    remote.turn(page=2)
    assert remote.commanding.told(remote.record)["sliders"]["page"] == 2


def test_damp_ends_it(remote):
    remote.commanding.hear(1, Take("elbow"))
    remote.turn(1.0)
    remote.tick(Intent.DAMP)
    assert remote.record.output.control_mode.mode is Mode.DAMPING
    remote.turn()
    assert remote.text == "sliders let go: mode is DAMPING"
    remote.turn(0.2)
    remote.local.enter_remote()
    remote.tick()
    remote.turn(0.2)
    assert remote.is_passive


def test_another_producers_remote_is_not_taken(remote):
    other = remote.local.intake("gravity")
    other.remote(rig.JOINTS, *([0.0] * N for _ in range(5)))
    remote.tick()
    with pytest.raises(FieldError, match=rf"sliders: REMOTE belongs to gravity \({os.getpid()}\)"):
        remote.commanding.hear(1, Take("elbow"))


def test_who_was_first_keeps_remote_and_the_page_is_told(remote):
    """The other one came in the moment between the status and the first command."""
    other = remote.local.intake("gravity")
    other.remote(rig.JOINTS, *([0.0] * N for _ in range(5)))
    remote.commanding.hear(1, Take("elbow"))
    for _ in range(40):
        other.remote(rig.JOINTS, *([0.0] * N for _ in range(5)))
        remote.turn()
    assert remote.text == f"sliders let go: REMOTE belongs to gravity ({os.getpid()})"
    assert not remote.moves
    assert remote.stiffness == [0.0] * N
    assert any(f"refused of {NAME}: REMOTE: belongs to gravity" in line for line in remote.local.told)


def test_a_console_that_was_held_up_for_long_lets_go(remote):
    remote.commanding.hear(1, Take("elbow"))
    remote.turn(1.0)
    for _ in range(30):
        remote.time[0] += int(1e9 * rig.PERIOD)
        remote.tick()
    remote.turn()
    assert remote.text == "sliders let go: the console was held up for 0.5 s"
    remote.turn(0.2)
    assert remote.is_passive


def test_close_ends_with_a_damped_command(remote):
    remote.commanding.start()
    remote.commanding.hear(1, Take("elbow"))
    remote.commanding.close()
    remote.tick()
    assert remote.stiffness == [0.0] * N


@pytest.fixture
def walking(desk):
    """In LOCOMOTION, of a policy that takes a velocity command."""
    import numpy as np  # noqa: PLC0415

    ranges = np.array([[-0.5, 1.0], [-0.3, 0.3], [-1.0, 1.0]])
    desk.commanding._speeds, desk.commanding._steering = ranges, Steering(ranges)
    for intent in (Intent.DAMP, Intent.LOAD_A):
        desk.tick(intent)
    for _ in range(6):
        desk.tick()
    desk.tick(Intent.START_LOCOMOTION)
    assert desk.record.output.control_mode.mode is Mode.LOCOMOTION
    return desk


def present(desk):
    return desk.commanding.told(desk.record)["steering"]["present"]


def test_a_velocity_reaches_the_session_and_ends_with_the_page(walking):
    walking.commanding.hear(1, Steer(0, 0.5))
    walking.turn(1.0)
    assert present(walking) == [0.5, 0.0, 0.0]
    assert walking.local.data.owners["velocity"] == NAME
    walking.turn(0.24, page=None)
    assert present(walking) == [0.5, 0.0, 0.0]
    walking.turn(0.04, page=None)
    assert present(walking) == [0.0, 0.0, 0.0]
    assert walking.text == "velocity let go: page 1 was not heard for 0.25 s"
    walking.turn(0.5)
    assert f"mark of {NAME}: {walking.text}" in walking.local.told
    assert present(walking) == [0.0, 0.0, 0.0]
    assert walking.local.data.owners["velocity"] == ""


def test_a_key_steps_from_anothers_command_and_a_stop_stops_it(walking):
    other = walking.local.intake("gamepad")
    other.velocity(0.3, 0.0, 0.0, deliberate=True)
    walking.turn()
    walking.commanding.hear(1, Press("w"))
    walking.turn(0.2)
    assert present(walking) == [0.4, 0.0, 0.0]
    other.velocity(0.3, 0.0, 0.0, deliberate=True)
    walking.turn(0.1)
    walking.commanding.hear(1, Press("0"))
    walking.turn(0.1)
    assert present(walking) == [0.0, 0.0, 0.0]


def test_who_took_the_velocity_keeps_it(walking):
    walking.commanding.hear(1, Steer(0, 0.5))
    walking.turn(0.4)
    other = walking.local.intake("gamepad")
    for _ in range(40):
        other.velocity(0.1, 0.0, 0.0, deliberate=False)
        walking.turn()
    assert present(walking) == [0.5, 0.0, 0.0]
    for _ in range(40):
        other.velocity(0.1, 0.0, 0.0, deliberate=True)
        walking.turn()
    assert present(walking) == [0.1, 0.0, 0.0]
    assert walking.text == f"velocity let go: gamepad ({os.getpid()}) controls it now"


def test_damp_ends_a_velocity(walking):
    walking.commanding.hear(1, Steer(0, 0.5))
    walking.turn(0.4)
    walking.tick(Intent.DAMP)
    walking.turn(0.4)
    assert present(walking) == [0.0, 0.0, 0.0]
    assert walking.text == "velocity let go: mode is DAMPING"
