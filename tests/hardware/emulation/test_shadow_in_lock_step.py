"""The frames on the wire with a shadow policy, with one that misbehaves, and without: the same ones."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from bus_rig import IDS, LITE, MODELS_BY_ID, Bench

from humanoid_sim.assets import SAMPLE_MOTION, SAMPLE_POLICY, motion_path
from humanoid_sim.hardware.robstride.codec import encode_command
from humanoid_sim.hardware.robstride.messages import OperationControl, Status
from humanoid_sim.messages import Intent, Mode, SessionHeader
from humanoid_sim.mit import MITCommand, MITState
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.loaded_policy import load_policy
from humanoid_sim.policy.motion import read_motion
from humanoid_sim.recording.codec import TickEncoder
from humanoid_sim.session.pace import LoopSettings
from humanoid_sim.session.session import Session
from humanoid_sim.session.shadow import ShadowSink
from humanoid_sim.session.sinks import Sink
from humanoid_sim.stack import build_supervisor, policy_controller

PERIOD = 0.02
INTENTS = {2: (Intent.DAMP,), 10: (Intent.LOAD_A,), 40: (Intent.START_LOCOMOTION,), 50: (Intent.DAMP,)}
TICKS = 60


class LockStepRobot:
    """The Lite's emulated motors, whose time goes on with each command and not otherwise."""

    def __init__(self):
        self.bench = Bench()
        self.sent = []
        self._turns = np.array([self.bench.turn(i) for i in range(len(IDS))])
        self._directions = np.array([joint.motor.direction for joint in LITE.joints if joint.motor is not None])
        self._heard = np.zeros((3, len(IDS)))
        self._state = MITState.unknown(len(IDS))

    @property
    def joints(self):
        return LITE.joint_names

    def activate(self):
        self.bench.enable()
        self.write(MITCommand.zeros(len(IDS)))

    def read(self):
        position, velocity, effort = self._heard * self._directions
        state = replace(
            self._state,
            time=self.bench.emulator.time,
            joint_position=position,
            joint_velocity=velocity,
            joint_effort=effort,
            joint_age=np.zeros(len(IDS)),
        )
        return state, ()

    def write(self, command):
        for i, motor_id in enumerate(IDS):
            sign = self._directions[i]
            told = OperationControl(
                motor_id,
                float(sign * command.position[i] + self._turns[i]),
                float(sign * command.velocity[i]),
                float(sign * command.effort[i]),
                float(command.stiffness[i]),
                float(command.damping[i]),
            )
            self.sent.append(encode_command(told, MODELS_BY_ID[motor_id]))
            self.bench.submit(told)
        for reply in self.bench.advance(PERIOD):
            if isinstance(reply, Status):
                i = IDS.index(reply.motor_id)
                self._heard[:, i] = reply.position - self._turns[i], reply.velocity, reply.effort

    def close(self):
        """Nothing to let go of."""


class Intents:
    """Gives the intents of each tick."""

    finished = False

    def __init__(self):
        self._polls = 0

    def poll(self, *_):
        self._polls += 1
        return INTENTS.get(self._polls - 1, ())


class Kept(Sink):
    def __init__(self):
        self.records = []

    def tick(self, record):
        self.records.append(record)


class Shadow:
    """The sample policy as a shadow, put into `wrap`."""

    def __init__(self, wrap):
        checkpoint = load_checkpoint(SAMPLE_POLICY)
        policy = wrap(checkpoint.policy)
        loaded = load_policy(checkpoint.contract, policy, read_motion(motion_path(SAMPLE_MOTION)))
        self.steps = []
        self.told = []
        self.sink = ShadowSink(
            policy_controller(LITE, PERIOD, loaded),
            "sample",
            LITE.effort_limit,
            realtime=False,
            publish=self.steps.append,
            tell=self.told.append,
        )


def wire(shadow):
    """The ticks, and the frames that left and came, each with the emulator's time."""
    robot, kept = LockStepRobot(), Kept()
    Session(
        robot,
        build_supervisor(quick_lite(), PERIOD, None),
        LoopSettings(PERIOD, realtime=False, duration=TICKS * PERIOD),
        header=SessionHeader("lite", LITE.joint_names, PERIOD, 0),
        intents=[Intents()],
        sinks=[kept] if shadow is None else [kept, shadow.sink],
    ).run()
    encoder = TickEncoder(len(IDS))
    ticks = [encoder.encode(replace(record, duration=0.0, overrun=False)) for record in kept.records]
    modes = [record.output.control_mode.mode for record in kept.records[:TICKS]]
    expected = 2 * [Mode.ZERO_TORQUE] + 8 * [Mode.DAMPING] + 40 * [Mode.STANDBY] + 10 * [Mode.DAMPING]
    assert modes == expected  # START_LOCOMOTION is refused
    return ticks, robot.sent, [(arrival.time, arrival.frame) for arrival in robot.bench.log]


def quick_lite():
    """The Lite, reaching its standby pose in 0.2 s."""
    short = msgspec.structs.replace(LITE.standby_controller_a, segment_durations=(0.1, 0.1))
    return msgspec.structs.replace(LITE, standby_controller_a=short)


@pytest.fixture(scope="module")
def alone():
    """Without a shadow."""
    return wire(None)


def nan(policy):
    return lambda observation, frame: np.full_like(policy(observation, frame), np.nan)


def raising(_):
    def fail(*_):
        raise RuntimeError("no")

    return fail


@pytest.mark.parametrize(("wrap", "steps"), [(lambda policy: policy, 58), (nan, 0), (raising, 0)])
def test_a_shadow_leaves_no_trace_on_the_wire(alone, wrap, steps):
    shadow = Shadow(wrap)
    ticks, sent, heard = wire(shadow)
    assert len(sent) == 14 * (len(ticks) + 1)
    assert ticks == alone[0]
    assert sent == alone[1]
    assert heard == alone[2]
    assert shadow.sink.error is None
    worked = [step for step in shadow.steps if not step.fault and step.tick < TICKS]
    assert len(worked) == steps
    assert (shadow.sink.faults > 0) == (steps == 0)
