"""An arm of two joints, robots like it whose truth is known, and recordings of what they do."""

from pathlib import Path

import msgspec
import numpy as np

from humanoid_sim.hardware.emulation.emulator import Emulator
from humanoid_sim.hardware.emulation.settings import EmulationSettings
from humanoid_sim.hardware.robstride.codec import decode_reply, encode_command
from humanoid_sim.hardware.robstride.messages import Enable, OperationControl, Status
from humanoid_sim.messages import ControlMode, Mode, SessionHeader, TickInput, TickOutput, TickRecord
from humanoid_sim.mit import MITCommand, MITState
from humanoid_sim.recording.recorder import McapRecorder
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.robots.motors import MOTORS
from humanoid_sim.robots.schema import JointDynamics
from humanoid_sim.simulation.mujoco_robot import MujocoRobot
from humanoid_sim.sysid.data import Run

PERIOD = 0.02
OFFSET = np.array([0.03, -0.02])
TRUTH = (
    JointDynamics(armature=0.015, friction=0.3, damping=0.1, torque_scale=0.9, delay=0.008),
    JointDynamics(armature=0.0075, friction=0.2, damping=0.05, torque_scale=1.1, delay=0.008),
)
_MJCF = """
<mujoco model="arm">
  <compiler angle="radian"/>
  <worldbody>
    <body name="base" pos="0 0 1">
      <geom type="box" size=".01 .01 .01" mass="1"/>
      <site name="imu"/>
      <body name="upper" pos="0 0 .1">
        <joint name="shoulder" axis="0 1 0" range="-1.5 1.5" armature="0.01" frictionloss="0.1"/>
        <geom type="capsule" fromto="0 0 .02 .3 0 .02" size=".02" mass="1"/>
        <body name="fore" pos=".35 0 0">
          <joint name="elbow" axis="0 1 0" range="-2 2" armature="0.005" frictionloss="0.1"/>
          <geom type="capsule" fromto="0.02 0 0 .25 0 0" size=".02" mass=".5"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
_YAML = """
name: arm
mjcf: arm.xml
joints:
  shoulder:
    stiffness: 50.0
    damping: 2.0
    effort_limit: 17.0
    motor: {bus: 0, can_id: 11, model: rs-02, direction: 1, torque_limit: 17.0, current_limit: 27.0}
  elbow:
    stiffness: 30.0
    damping: 1.0
    effort_limit: 14.0
    motor: {bus: 0, can_id: 12, model: rs-00, direction: -1, torque_limit: 14.0, current_limit: 16.0}
simulation: {physics_timestep: 0.001}
"""


def arm(folder: Path) -> RobotDescription:
    """The robot as it is described; its file is `arm.yaml`."""
    (folder / "arm.xml").write_text(_MJCF)
    (folder / "arm.yaml").write_text(_YAML)
    return load_robot(folder / "arm.yaml")


def planted(description: RobotDescription, truth=TRUTH, start=(0.0, 0.0)) -> RobotDescription:
    """The robot as it really is."""
    joints = (
        msgspec.structs.replace(joint, dynamics=own) for joint, own in zip(description.joints, truth, strict=True)
    )
    return msgspec.structs.replace(description, joints=tuple(joints), initial_position=tuple(start))


def motion(duration: float) -> np.ndarray:
    """Shape (frames, 2), rad: sines, slow and fast."""
    time = PERIOD * np.arange(round(duration / PERIOD))
    tones = ((0.13, 0.42, 1.1, 2.3), (0.19, 0.53, 1.3, 2.7))
    target = np.stack(
        [sum(0.55 / (i + 1) * np.sin(2 * np.pi * f * time + i) for i, f in enumerate(own)) for own in tones], axis=1
    )
    target *= np.minimum(time / 1.0, 1.0)[:, None]
    return target


def simulated(truth: RobotDescription, target: np.ndarray, seed: int = 0, offset=OFFSET, noise: float = 1.0) -> Run:
    """What a host would record of a simulated robot that follows a motion: quantised, with noise and offsets."""
    robot, random, zeros = MujocoRobot(truth, control_period=PERIOD), np.random.default_rng(seed), np.zeros(2)
    rows = []
    for goal in target:
        state, _ = robot.read()
        position = _rounded(state.joint_position + offset + noise * random.normal(0.0, 2e-4, 2), 3.8e-4)
        velocity = _rounded(state.joint_velocity + noise * random.normal(0.0, 5e-3, 2), 1.3e-3)
        fields = (goal, zeros, zeros, truth.stiffness, truth.damping)
        rows.append((state.time, position, velocity, state.joint_effort, zeros, np.stack(fields)))
        robot.write(MITCommand(goal - offset, *fields[1:]))
    return _run(rows)


def emulated(truth: RobotDescription, target: np.ndarray, offset=OFFSET) -> Run:
    """What a host would record of emulated motors, their frames and buses included; it reads, then writes."""
    motors = [joint.motor for joint in truth.joints]
    direction = np.array([motor.direction for motor in motors])
    models = {motor.can_id: MOTORS[motor.model] for motor in motors}
    offsets = dict(zip(truth.joint_names, (direction * offset).tolist(), strict=True))
    emulator = Emulator(truth, settings=EmulationSettings(homing_offset=offsets))
    turns = np.array([round(-state.origin / (2 * np.pi)) * 2 * np.pi for state in emulator.motors.states])
    heard, zeros, rows = np.zeros((4, len(motors))), np.zeros(len(motors)), []

    def send(commands) -> None:
        for command in commands:
            emulator.submit(0, encode_command(command, models[command.motor_id]), emulator.time)

    def listen(until: float) -> None:
        for arrival in emulator.advance(until):
            reply = decode_reply(arrival.frame, models, 0xFD)
            if isinstance(reply, Status):
                i = [motor.can_id for motor in motors].index(reply.motor_id)
                heard[:, i] = reply.position - turns[i], reply.velocity, reply.effort, arrival.time

    send(Enable(motor.can_id) for motor in motors)
    listen(0.02)
    for tick, goal in enumerate(target):
        time = 0.02 + tick * PERIOD
        position, velocity, effort = direction * heard[:3]
        rows.append(
            (
                time,
                position,
                velocity,
                effort,
                time - heard[3],
                np.stack([goal, zeros, zeros, truth.stiffness, truth.damping]),
            )
        )
        send(
            OperationControl(
                m.can_id,
                float(direction[i] * goal[i] + turns[i]),
                0.0,
                0.0,
                float(truth.stiffness[i]),
                float(truth.damping[i]),
            )
            for i, m in enumerate(motors)
        )
        listen(time + PERIOD)
    return _run(rows)


def write(path: Path, run: Run, description: RobotDescription) -> Path:
    """Write a run as a recording."""
    recorder = McapRecorder(path)
    recorder.start(
        SessionHeader(description.name, description.joint_names, PERIOD, 0, {"robot": description.to_json()})
    )
    for i, time in enumerate(run.time):
        state = MITState(
            time,
            run.position[i],
            run.velocity[i],
            run.effort[i],
            run.age[i],
            run.quaternion[i],
            np.zeros(3),
            np.zeros(3),
        )
        output = TickOutput(MITCommand(*run.command[i]), ControlMode(Mode.LOCOMOTION, "policy"))
        recorder.tick(TickRecord(i, TickInput(state), output, 0.0, overrun=False))
    recorder.close()
    return path


def true_values(truth=TRUTH, offset=OFFSET) -> np.ndarray:
    """Shape (6, 2), in the order of `KINDS`."""
    known = ("armature", "friction", "damping", "torque_scale")
    return np.array([*([getattr(own, name) for own in truth] for name in known), offset, [own.delay for own in truth]])


def _run(rows) -> Run:
    time, position, velocity, effort, age, command = (np.array(column) for column in zip(*rows, strict=True))
    return Run("run", time, position, velocity, effort, age, command, np.tile([1.0, 0.0, 0.0, 0.0], (len(time), 1)))


def _rounded(values: np.ndarray, step: float) -> np.ndarray:
    return np.round(values / step) * step
