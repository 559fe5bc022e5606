"""An arm of two joints, robots like it whose dynamics are known, and what emulated motors of them report."""

from pathlib import Path

import msgspec
import numpy as np

from humanoid_sim.hardware.mock.motors import MockMotors
from humanoid_sim.hardware.robstride.codec import decode_reply, encode_command
from humanoid_sim.hardware.robstride.messages import Enable, OperationControl, Status
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.robots.motors import MOTORS
from humanoid_sim.robots.schema import JointDynamics

PERIOD = 0.02
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


def emulated(truth: RobotDescription, target: np.ndarray) -> np.ndarray:
    """Shape (frames, 2), N·m: what emulated motors report to a host that reads, then writes, in each period."""
    motors = [joint.motor for joint in truth.joints]
    direction = np.array([motor.direction for motor in motors])
    models = {motor.can_id: MOTORS[motor.model] for motor in motors}
    mock = MockMotors(truth)
    turns = np.array([round(-motor.origin / (2 * np.pi)) * 2 * np.pi for motor in mock.motors])
    heard, rows = np.zeros(len(motors)), []

    def send(commands) -> None:
        for command in commands:
            mock.submit(0, encode_command(command, models[command.motor_id]), mock.time)

    def listen(until: float) -> None:
        for arrival in mock.advance(until):
            reply = decode_reply(arrival.frame, models, 0xFD)
            if isinstance(reply, Status):
                heard[[motor.can_id for motor in motors].index(reply.motor_id)] = reply.effort

    send(Enable(motor.can_id) for motor in motors)
    listen(0.02)
    for tick, goal in enumerate(target):
        rows.append(direction * heard)
        positions, gains = direction * goal + turns, zip(truth.stiffness, truth.damping, strict=True)
        send(
            OperationControl(motor.can_id, float(position), 0.0, 0.0, float(stiffness), float(damping))
            for motor, position, (stiffness, damping) in zip(motors, positions, gains, strict=True)
        )
        listen(0.02 + (tick + 1) * PERIOD)
    return np.array(rows)
