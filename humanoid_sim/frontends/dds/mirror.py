"""A robot on another machine, as its DDS topics show it, for watching only."""

from __future__ import annotations

import copy
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np

from humanoid_sim.client import monotonic_ns
from humanoid_sim.dds_client import JointStates, RobotClient
from humanoid_sim.frontends.attach import Source, Tick, attached
from humanoid_sim.messages import SafetyLevel, SafetyStatus, SessionHeader, TickInput, TickOutput, TickRecord
from humanoid_sim.mit import FloatArray, MITCommand, MITState
from humanoid_sim.recording.links import urdf_model
from humanoid_sim.simulation.model import joint_addresses

_PERIOD = 0.02  # s between two messages of a robot's topics on hardware
_KEEP_SHAPES = '<mujoco><compiler discardvisual="false"/></mujoco>'  # MuJoCo drops what a URDF only shows
_SAFETY = SafetyStatus(SafetyLevel.WARNING, source="network", message="not known here: it stays on the robot's machine")


class Mirror(Source):
    """Ticks from topics. For one thread."""

    is_hardware = True

    def __init__(self, client: RobotClient, prefix: str) -> None:
        """Wait for a robot. Raises `InputError` if its description is not a URDF, or lacks joints that it reports."""
        self._client, self._where = client, f"{prefix} on DDS"
        print(f"waiting for {self._where}", flush=True)
        states = client.state()
        while states is None or client.control_mode() is None or client.description() is None:
            states = client.state() or states
        self._start = states.time_ns
        urdf = client.description() or ""
        self._model = urdf_model(re.sub("(<robot[^>]*>)", rf"\1{_KEEP_SHAPES}", urdf, count=1))
        self._joints = joint_addresses(self._model, states.names).qpos
        self.header = SessionHeader(prefix, states.names, _PERIOD, self._start)
        self._count = 0

    def __str__(self) -> str:
        return self._where

    def model(self) -> mujoco.MjModel:
        return copy.copy(self._model)

    def ticks(self, timeout: float = 0.0) -> list[Tick]:
        states, control_mode = self._client.state(timeout), self._client.control_mode()
        if states is None or control_mode is None or states.names != self.header.joint_names:
            return []
        unknown = np.full(len(states.names), np.nan)  # commands are not on the network
        vectors = (np.full(4, np.nan), np.full(3, np.nan), np.full(3, np.nan))
        imu = self._client.imu()
        if imu is not None:
            vectors = (imu.quaternion, imu.angular_velocity, imu.linear_acceleration)
        time = 1e-9 * (states.time_ns - self._start)
        joints = (states.position, states.velocity, states.effort, np.zeros(len(states.names)))
        tick_input = TickInput(MITState(time, *joints, *vectors), (_SAFETY,))
        output = TickOutput(MITCommand(unknown, unknown, unknown, unknown, unknown), control_mode)
        self._count += 1
        self.latest = Tick(TickRecord(self._count, tick_input, output, 0.0, False, self._qpos(states)), monotonic_ns())
        return [self.latest]

    def _qpos(self, states: JointStates) -> FloatArray:
        """Return MuJoCo's `qpos`: the joints, and a base that moves where `/tf` has it."""
        qpos: FloatArray = self._model.qpos0.copy()
        known = np.isfinite(states.position)
        qpos[self._joints[known]] = states.position[known]
        if self._model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE:
            pose = self._client.frame_pose(self._model.body(int(self._model.jnt_bodyid[0])).name)
            if pose is not None and np.isfinite(pose).all():
                qpos[:7] = pose
        return qpos


@dataclass(frozen=True)
class Watched:
    """Options of a front end that can also show a robot on another machine, for watching only."""

    session: int | None = None
    """Process id of the session. Default: the only one that runs."""
    dds: str = ""
    """A network interface such as eth1: show the robot there, from its DDS topics alone, for watching only."""
    prefix: str = "lite"
    """With --dds: what the robot's joint states are under."""

    @contextmanager
    def source(self, name: str) -> Iterator[Source]:
        """Attach the front end of that name. Raises `InputError`."""
        if not self.dds:
            with attached(self.session, name) as attachment:
                yield attachment
            return
        with RobotClient(self.prefix, interface=self.dds) as client:
            yield Mirror(client, self.prefix)
