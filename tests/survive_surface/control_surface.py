"""The only place where these tests touch names of the product; a rewrite changes this file and no test."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from humanoid_sim.controllers.base import Fault, Memory
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.damping import DampingController, ZeroTorqueController
from humanoid_sim.controllers.guards import Guards
from humanoid_sim.controllers.reference import no_reference
from humanoid_sim.controllers.remote_policy import RemotePolicyController
from humanoid_sim.controllers.rl_policy import RLPolicyController
from humanoid_sim.controllers.standby import StandbyController
from humanoid_sim.controllers.supervisor import Supervisor
from humanoid_sim.controllers.terms import Term
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.messages import TickInput, TickOutput
from humanoid_sim.mit import MITCommand

INPUT_ERRORS = (FieldError, InputError)
"""Exceptions for what a user gave."""


# The pure part.


@dataclass(frozen=True)
class StackConfig:
    """Parameters of a control stack."""

    joints: tuple[str, ...]
    period: float
    """s between two ticks."""
    damping: Mapping[str, float]
    """K_d of DAMPING, by joint."""
    poses: Mapping[str, Mapping[str, float]]
    """Last pose of `a` and `b`, rad, by joint; the first is all zeros."""
    segment_duration: float
    """s of each of the two segments of a pose."""
    standby_gains: tuple[float, float]
    passive_damping: float
    """K_d of REMOTE without commands."""
    policy: Callable[[np.ndarray, int], Any]
    """Observation and frame to action."""
    contract: Mapping[str, Any]
    """A checkpoint's, by the keys of its metadata."""
    live: Mapping[str, int]
    """Name and width of live inputs that the policy observes behind its other terms."""
    stale_command_policy: str = "passive"
    is_floating: bool = False
    guards: Mapping[str, Any] | None = None
    """Bounds of the guards, one number for all joints; None: no guards."""
    replaced: Mapping[str, Any] | None = None
    """Controllers of `controller` in place of the product's, by name."""


def supervisor(config: StackConfig) -> Any:
    """Make the control stack."""
    joints = config.joints
    zeros = [0.0] * len(joints)
    stiffness, damping = config.standby_gains
    controllers: dict[str, Any] = {
        "zero_torque_controller": ZeroTorqueController(joints),
        "damping_controller": DampingController(joints, damping=[config.damping[name] for name in joints]),
        "rl_policy_controller": RLPolicyController(
            joints, _contract(config), no_reference(), config.policy, config.period, extern=_live_inputs(config)
        ),
        "remote_policy_controller": RemotePolicyController(
            joints, stale_command_policy=config.stale_command_policy, damping_scalar=config.passive_damping
        ),
    }
    for name, pose in config.poses.items():
        controllers[f"standby_controller_{name}"] = StandbyController(
            joints,
            target_stiffness=stiffness,
            target_damping=damping,
            segment_durations=[config.segment_duration] * 2,
            pose_segments=[zeros, [pose[joint] for joint in joints]],
        )
    controllers.update(config.replaced or {})
    return Supervisor(joints, controllers, guards=_guards(config), needs_producer=config.is_floating)


def _contract(config: StackConfig) -> PolicyContract:
    keys = dict(config.contract)
    live = [Term(name, width=width) for name, width in config.live.items()]
    observation = [*keys.pop("observation_names"), *live]
    return PolicyContract(**keys, observation=observation)


def _live_inputs(config: StackConfig) -> Mapping[str, int]:
    return {"velocity_command": 3, **config.live}


def _guards(config: StackConfig) -> Guards | None:
    if config.guards is None:
        return None
    times = ("following_time", "following_progress", "limit_time", "speed_time")
    n = len(config.joints)
    bounds = {name: value if name in times else np.full(n, value) for name, value in config.guards.items()}
    return Guards(config.joints, **bounds)


def initial(stack: Any) -> Any:
    """Return the memory before the first tick."""
    return stack.initial()


def step(stack: Any, memory: Any, tick_input: TickInput) -> tuple[Any, TickOutput]:
    """One tick of the pure function."""
    after: tuple[Any, TickOutput] = stack.step(memory, tick_input)
    return after


@dataclass(frozen=True, eq=False)
class _Controller:
    """A controller from outside the product."""

    joints: tuple[str, ...]
    on_activate: Callable[[TickInput], Any]
    on_update: Callable[[TickInput], Any]
    fallback: ClassVar[str | None] = "damping_controller"

    def activate(self, tick_input: TickInput) -> Any:
        self.on_activate(tick_input)
        return Memory()

    def update(self, memory: Any, tick_input: TickInput) -> Any:
        answer = self.on_update(tick_input)
        return answer if isinstance(answer, Fault) else (memory, answer)


class _Damping(_Controller):
    fallback: ClassVar[str | None] = "zero_torque_controller"


def controller(
    name: str,
    joints: Sequence[str],
    update: Callable[[TickInput], MITCommand],
    activate: Callable[[TickInput], None] = lambda _: None,
) -> Any:
    """Make a controller for `StackConfig.replaced` whose command is what `update` returns; both may raise."""
    return (_Damping if name == "damping_controller" else _Controller)(tuple(joints), activate, update)


def fault(reason: str) -> Any:
    """What a controller returns in place of a command where it knows that it has failed."""
    return Fault(reason)
