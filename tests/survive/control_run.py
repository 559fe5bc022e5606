"""A control stack of three joints whose controllers are told apart by their gains, stepped on a virtual clock."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from control_surface import StackConfig, initial, step, supervisor

from humanoid_sim.messages import Intent, RemoteCommand, SafetyStatus, TickInput, TickOutput
from humanoid_sim.mit import COMMAND_FIELDS, Extern, MITCommand, MITState

JOINTS = ("shoulder", "elbow", "wrist")
PERIOD = 0.02
MEASURED = {"shoulder": 0.4, "elbow": 0.5, "wrist": 0.6}
DAMPING_KD = {"shoulder": 1.5, "elbow": 1.6, "wrist": 1.7}
PASSIVE_KD = 6.5
POLICY_KP = {"shoulder": 33.0, "elbow": 32.0, "wrist": 31.0}
POLICY_KD = {"shoulder": 3.3, "elbow": 3.2, "wrist": 3.1}

ZERO = "zero_torque_controller"
DAMPING = "damping_controller"
A, B = "standby_controller_a", "standby_controller_b"
RL = "rl_policy_controller"
REMOTE = "remote_policy_controller"

CONTRACT = {
    "task_type": "locomotion",
    "joint_names": ("wrist", "elbow", "shoulder"),  # another order than the robot's
    "action_joint_names": ("elbow", "shoulder"),
    "joint_stiffness": [31.0, 32.0, 33.0],
    "joint_damping": [3.1, 3.2, 3.3],
    "default_joint_pos": [0.01, 0.02, 0.03],
    "observation_names": ("joint_pos", "joint_vel", "actions", "imu_angular_velocity", "velocity_commands"),
    "command_names": (),
    "action_scale": [0.5, 0.25],
    "policy_dt": 2 * PERIOD,
    "body_names": (),
}


@dataclass
class Policy:
    """Answers `answer`, or what it returns where it is a function; keeps what it saw."""

    answer: Any = field(default_factory=lambda: np.array([1.0, -1.0], dtype=np.float32))
    seen: list[np.ndarray] = field(default_factory=list)

    def __call__(self, observation: np.ndarray, frame: int) -> Any:
        self.seen.append(np.array(observation))
        return self.answer(observation) if callable(self.answer) else self.answer


def config(**changes: Any) -> StackConfig:
    values: dict[str, Any] = {
        "joints": JOINTS,
        "period": PERIOD,
        "damping": DAMPING_KD,
        "poses": {"a": dict(zip(JOINTS, (0.1, 0.2, 0.3), strict=True)), "b": dict.fromkeys(JOINTS, -0.1)},
        "segment_duration": 1.5 * PERIOD,  # finished four ticks after the one of LOAD, however the clock is rounded
        "standby_gains": (20.0, 2.0),
        "passive_damping": PASSIVE_KD,
        "policy": Policy(),
        "contract": CONTRACT,
        "live": {},
    }
    return StackConfig(**{**values, **changes})


def state(
    time: float = 0.0,
    position: Mapping[str, float] = MEASURED,
    velocity: float = 0.0,
    joints: tuple[str, ...] = JOINTS,
    extern: Mapping[str, Extern] | None = None,
) -> MITState:
    """An upright robot whose joints are all heard; `velocity` in rad/s of each joint."""
    n = len(joints)
    return MITState(
        time=time,
        joint_position=[position[name] for name in joints],
        joint_velocity=np.full(n, velocity),
        joint_effort=np.zeros(n),
        joint_age=np.zeros(n),
        imu_quaternion=[1.0, 0.0, 0.0, 0.0],
        imu_angular_velocity=np.zeros(3),
        imu_linear_acceleration=[0.0, 0.0, 9.81],
        extern=extern or {},
    )


def command(position: float = 0.7, n: int = len(JOINTS), **fields: Any) -> MITCommand:
    """A remote command that no controller of this stack would give."""
    values = {"position": position, "velocity": 0.0, "effort": 0.1, "stiffness": 40.0, "damping": 4.0}
    return MITCommand(**{**{name: np.full(n, value) for name, value in values.items()}, **fields})


class Run:
    """One control stack, one tick after the other."""

    def __init__(self, **changes: Any) -> None:
        self.config = config(**changes)
        self.stack = supervisor(self.config)
        self.memory = initial(self.stack)
        self.time = 10.0

    def input(
        self,
        *intents: Intent,
        safety: tuple[SafetyStatus, ...] = (),
        remote: RemoteCommand | None = None,
        **measured: Any,
    ) -> TickInput:
        return TickInput(state(self.time, joints=self.config.joints, **measured), safety, intents, remote)

    def step(self, *intents: Intent, **inputs: Any) -> TickOutput:
        self.memory, output = step(self.stack, self.memory, self.input(*intents, **inputs))
        self.time += PERIOD
        return output

    def reach(self, controller: str, *, finished: bool = True, **inputs: Any) -> "Run":
        """Go to a controller as an operator does; to a standby controller that has `finished`, or just begun."""
        for intent in PATHS[controller]:
            output = self.step(intent, **inputs)
            if output.standby is not None and (finished or controller not in (A, B)):
                for _ in range(4):
                    output = self.step(**inputs)
                assert output.standby.is_finished
        assert (output if PATHS[controller] else self.step(**inputs)).control_mode.controller_name == controller
        return self


PATHS: Mapping[str, tuple[Intent, ...]] = {
    ZERO: (),
    DAMPING: (Intent.DAMP,),
    A: (Intent.DAMP, Intent.LOAD_A),
    B: (Intent.DAMP, Intent.LOAD_B),
    RL: (Intent.DAMP, Intent.LOAD_A, Intent.START_LOCOMOTION),
    REMOTE: (Intent.DAMP, Intent.LOAD_B, Intent.START_REMOTE),
}


def is_complete(sent: MITCommand, n: int = len(JOINTS)) -> bool:
    """A finite number in every field of every joint."""
    return all(getattr(sent, name).shape == (n,) and np.isfinite(getattr(sent, name)).all() for name in COMMAND_FIELDS)


def is_damping(output: TickOutput) -> bool:
    """The tick is DAMPING's, and so is the command that leaves in it."""
    sent = output.command
    pushes = sent.velocity.any() or sent.effort.any() or sent.stiffness.any()
    is_damped = sent.damping.tolist() == list(DAMPING_KD.values())
    return output.control_mode.controller_name == DAMPING and is_complete(sent) and is_damped and not pushes


def bits(sent: MITCommand) -> list[bytes]:
    return [getattr(sent, name).tobytes() for name in COMMAND_FIELDS]
