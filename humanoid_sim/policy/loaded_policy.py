"""A policy and its motion, checked against each other, and the layout of its observation."""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.observation import ObservationLayout, resolve_observation
from humanoid_sim.controllers.policy_step import Policy
from humanoid_sim.controllers.reference import MotionReference, build_reference, build_world_reference, no_reference
from humanoid_sim.controllers.terms import value_names
from humanoid_sim.errors import FieldError, blaming
from humanoid_sim.mit import KEY_PRESSED
from humanoid_sim.policy.motion import Motion
from humanoid_sim.robots.piano import KEY_COUNT
from humanoid_sim.ros2.topics import LIVE_INPUT, topic_kind


@dataclass(frozen=True, slots=True)
class LoadedPolicy:
    """A policy with its motion, checked against each other."""

    contract: PolicyContract
    reference: MotionReference
    policy: Policy
    motion: Motion | None = None  # what the reference was made of

    @property
    def extern(self) -> Mapping[str, int]:
        """Name and width of a simulation's live inputs: command, estimates, and pressed keys, as many as goal keys."""
        keys = self.reference.terms.get("target_keys")
        widths = self.contract.extern_widths
        return widths if keys is None else {**widths, KEY_PRESSED: keys.shape[1]}

    def live_inputs(self, reported: Container[str]) -> Mapping[str, int]:
        """Name and width of the live inputs that a session takes from outside, less those that the robot reports."""
        live = {*self.contract.live_topics, KEY_PRESSED}  # the score of a run needs the keys, observed or not
        return {name: width for name, width in self.extern.items() if name in live and name not in reported}

    @property
    def layout(self) -> ObservationLayout:
        """The observation in the policy's own joint order; names and widths are the same on every robot."""
        return resolve_observation(self.contract, self.contract.joint_names, self.reference, self.extern)

    @property
    def observation_labels(self) -> dict[str, tuple[str, ...]]:
        """The joints of the values of each term that shows one value of each joint."""
        joints = {bound.name: (value_names(bound.term, self.contract), bound.width) for bound in self.layout.terms}
        return {name: names for name, (names, width) in joints.items() if len(set(names)) == width}


def load_policy(
    contract: PolicyContract,
    policy: Policy,
    motion: Motion | None,
    observation_width: int | None = None,
    *,
    source: str = "policy",
) -> LoadedPolicy:
    """Bring a policy and its motion together, N as the model declares it; raises `InputError` if they do not fit."""
    with blaming(source):
        for name, topic in contract.live_topics.items():
            if topic_kind(topic.name) is not LIVE_INPUT:
                raise FieldError(f"live input '{name}': its topic is {topic.name}, which a session uses itself")
        loaded = LoadedPolicy(contract, _reference(contract, motion), policy, motion)
        layout = loaded.layout
        if observation_width not in (None, layout.width):
            raise FieldError(f"observation: {width_problem(layout, observation_width)}")
    return loaded


def width_problem(layout: ObservationLayout, width: int | None) -> str:
    """Return how the terms do not add up to the model's input."""
    terms = " + ".join(f"{term.name} {term.width}" for term in layout.terms)
    return f"is {layout.width} wide, the model's input {width}: {terms}"


def _reference(contract: PolicyContract, motion: Motion | None) -> MotionReference:
    task = contract.task_type
    if task == "locomotion":
        return no_reference()
    if motion is None:
        raise FieldError(f"task_type {task} follows a motion, and none is given: use --motion")
    if motion.task_type not in ("", task):
        raise FieldError(f"motion: is for task_type {motion.task_type}, expected one for {task}")
    if not np.isclose(motion.policy_dt, contract.policy_dt, rtol=1e-6):
        rates = f"{motion.policy_dt:g} s, expected policy_dt {contract.policy_dt:g} s"
        raise FieldError(f"motion: has a frame every {rates}; resample it")
    if motion.layout == "joints_bodies_w":
        return build_world_reference(contract, motion.frames, motion.joint_names, motion.body_names)
    if task == "tracking" and motion.body_names not in ((), contract.body_names):
        raise FieldError(f"motion: describes {motion.body_names}, expected the bodies {contract.body_names}")
    return build_reference(contract, motion.frames)


def contract_layout(contract: PolicyContract) -> ObservationLayout:
    """Return the observation in the policy's own joint order, whatever motion there is; `FieldError` for a bad term."""
    joints, bodies = len(contract.joint_names), len(contract.body_names)
    widths = {
        **{"reference_joint_pos": joints, "reference_joint_vel": joints, "anchor_pos": 3, "anchor_quat": 4},
        **{"motion_body_pos_b": 3 * bodies, "motion_body_ori_b": 6 * bodies},
        **{"target_keys": KEY_COUNT, "target_keys_future": KEY_COUNT * len(contract.lookahead_steps)},
    }
    reference = MotionReference(1, {name: np.zeros((1, width), dtype=np.float32) for name, width in widths.items()})
    extern = {KEY_PRESSED: KEY_COUNT, **contract.extern_widths}
    return resolve_observation(contract, contract.joint_names, reference, extern)
