"""A small control stack whose controllers can be told apart by their gains alone, and ticks to feed it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.damping import DampingController, ZeroTorqueController
from humanoid_sim.controllers.reference import MotionReference
from humanoid_sim.controllers.remote_policy import RemotePolicyController
from humanoid_sim.controllers.rl_policy import RLPolicyController
from humanoid_sim.controllers.standby import StandbyController
from humanoid_sim.controllers.supervisor import Supervisor, SupervisorMemory
from humanoid_sim.messages import Intent, RemoteCommand, SafetyStatus, TickInput, TickOutput
from humanoid_sim.mit import Extern, MITCommand, MITState
from humanoid_sim.testing.healthy import healthy_state

JOINTS = ("shoulder", "elbow", "wrist")
PERIOD = 0.02
DAMPING_KD = [1.5, 1.6, 1.7]
PASSIVE_KD = [6.5, 6.5, 6.5]
POSE_A = [0.1, 0.2, 0.3]
POSE_B = [-0.1, -0.2, -0.3]
KNOWN = (0.4, 0.5, 0.6)


def contract(**changes: Any) -> PolicyContract:
    """A tracking policy whose joints come in another order than the robot's; it drives two of the three."""
    values: dict[str, Any] = {
        "task_type": "tracking",
        "joint_names": ("wrist", "elbow", "shoulder"),
        "action_joint_names": ("elbow", "shoulder"),
        "joint_stiffness": [31.0, 32.0, 33.0],
        "joint_damping": [3.1, 3.2, 3.3],
        "default_joint_pos": [0.01, 0.02, 0.03],
        "observation": ("motion_body_pos_b", "joint_pos", "joint_vel", "actions", "progress", "velocity_command"),
        "command_names": (),
        "action_scale": [0.5, 0.25],
        "policy_dt": 0.04,
        "body_names": ("hand",),
    }
    return PolicyContract(**{**values, **changes})


def reference(frames: int = 4) -> MotionReference:
    """Frame k of `motion_body_pos_b` is (k, k + 0.25, k + 0.5)."""
    rows = np.arange(frames)[:, None] + np.array([0.0, 0.25, 0.5])
    return MotionReference(frames, {"motion_body_pos_b": rows})


def good_answer(observation: np.ndarray, frame: int) -> np.ndarray:
    """An action within limits that depends on everything the policy sees."""
    return np.array([np.tanh(observation.sum(dtype=np.float64)), 0.1 * frame])


def standby(stiffness: list[float], damping: list[float], pose: list[float]) -> StandbyController:
    """It is finished 4 ticks after activation, however the clock is rounded."""
    return StandbyController(JOINTS, stiffness, damping, [1.5 * PERIOD] * 2, [[0.0, 0.0, 0.0], pose])


def supervisor(policy: Callable[..., Any] = good_answer, **replaced: Any) -> Supervisor:
    """Every controller; `replaced` by name, None to leave one out."""
    controllers = {
        "zero_torque_controller": ZeroTorqueController(JOINTS),
        "damping_controller": DampingController(JOINTS, np.array(DAMPING_KD)),
        "standby_controller_a": standby([10.0, 11.0, 12.0], [1.0, 1.1, 1.2], POSE_A),
        "standby_controller_b": standby([20.0, 21.0, 22.0], [2.0, 2.1, 2.2], POSE_B),
        "rl_policy_controller": RLPolicyController(
            JOINTS, contract(), reference(), policy, control_period=PERIOD, extern={"velocity_command": 3}
        ),
        "remote_policy_controller": RemotePolicyController(JOINTS, np.array(PASSIVE_KD)),
    }
    controllers.update(replaced)
    return Supervisor(JOINTS, {name: value for name, value in controllers.items() if value is not None})


def two_policies(walk: Callable[..., Any] = good_answer, dance: Callable[..., Any] = good_answer) -> Supervisor:
    """A policy of each tick beside the usual one; `walk` is selected at the start."""
    usual = supervisor(walk)
    quick = replace(usual.controllers["rl_policy_controller"], policy=dance, contract=contract(policy_dt=PERIOD))
    return replace(usual, policies={"walk": usual.controllers["rl_policy_controller"], "dance": quick})


def state(time: float = 0.0, position: Sequence[float] = KNOWN, **changes: Any) -> MITState:
    """A robot at rest and upright."""
    return replace(healthy_state(position, time), **changes)


def tick(
    time: float = 0.0,
    *intents: Intent,
    position: Sequence[float] = KNOWN,
    safety: tuple[SafetyStatus, ...] = (),
    remote: RemoteCommand | None = None,
    extern: dict[str, Extern] | None = None,
    policy: str = "",
) -> TickInput:
    """One tick's input."""
    return TickInput(state(time, position, extern=extern or {}), safety, intents, remote, policy)


def command(value: float = 0.7, n: int = len(JOINTS), **changes: Any) -> MITCommand:
    """A valid remote command that no controller of the rig would give."""
    ones = np.ones(n)
    valid = MITCommand(value * ones, 0.0 * ones, 0.1 * ones, 40.0 * ones, 4.0 * ones)
    return replace(valid, **changes) if changes else valid


@dataclass
class Run:
    """A supervisor that is being stepped with its own clock, one `PERIOD` a tick."""

    supervisor: Supervisor
    time: float = 10.0

    def __post_init__(self) -> None:
        self.memory: SupervisorMemory = self.supervisor.initial()

    def step(self, *intents: Intent, policy: str = "", **inputs: Any) -> TickOutput:
        """One tick."""
        given = replace(tick(self.time, *intents, **inputs), policy=policy)
        self.memory, output = self.supervisor.step(self.memory, given)
        self.time += PERIOD
        return output

    def walk(self, *intents: Intent) -> TickOutput:
        """One tick per intent, waiting for a standby controller to finish after a LOAD."""
        output = self.step()
        for intent in intents:
            output = self.step(intent)
            if intent in (Intent.LOAD_A, Intent.LOAD_B):
                for _ in range(4):
                    output = self.step()
                assert output.standby.is_finished
        return output


PATHS: dict[str, tuple[Intent, ...]] = {
    "zero_torque_controller": (),
    "damping_controller": (Intent.DAMP,),
    "standby_controller_a": (Intent.DAMP, Intent.LOAD_A),
    "standby_controller_b": (Intent.DAMP, Intent.LOAD_B),
    "rl_policy_controller": (Intent.DAMP, Intent.LOAD_A, Intent.START_LOCOMOTION),
    "remote_policy_controller": (Intent.DAMP, Intent.LOAD_B, Intent.START_REMOTE),
}
"""How an operator gets to each controller."""
