"""One policy step: by itself as the controller does it, in a batch as its robots do it, bit for bit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from humanoid_sim.controllers.context import ANCHOR_POSE, EXTERN_WIDTHS, VELOCITY_COMMAND
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.phase import PhaseRule
from humanoid_sim.controllers.policy_step import PolicyMemory, PolicyWiring
from humanoid_sim.controllers.reference import build_world_reference
from humanoid_sim.controllers.rl_policy import RLPolicyController, RLPolicyMemory
from humanoid_sim.controllers.terms import Term
from humanoid_sim.errors import FieldError
from humanoid_sim.messages import TickInput
from humanoid_sim.mit import Extern, FloatArray, MITState

JOINTS = ("a", "b", "c")
STEPS, ROBOTS = 8, 4


def contract(**changes: Any) -> PolicyContract:
    """Everything that has a memory: history, phase, a reference laid onto the robot, the last action."""
    fields: dict[str, Any] = {
        "task_type": "tracking",
        "joint_names": ("c", "a", "b"),
        "action_joint_names": ("b", "c"),
        "joint_stiffness": [50.0, 40.0, 30.0],
        "joint_damping": [2.0, 1.5, 1.0],
        "default_joint_pos": [0.1, 0.2, 0.3],
        "observation": (
            Term("joint_pos", history=3),
            Term("projected_gravity", scale=2.0),
            "motion_anchor_pos_b",
            "motion_anchor_ori_b",
            Term("actions", history=2, history_order="newest_first"),
            "gait_phase",
            "velocity_commands",
            "motion_command",
        ),
        "command_names": ("motion",),
        "action_scale": [0.5, 0.25],
        "policy_dt": 0.02,
        "body_names": ("torso",),
        "anchor_body": "torso",
        "phase": PhaseRule(period=0.7, standing_threshold=0.3),
    }
    return PolicyContract(**{**fields, **changes})


def frames() -> FloatArray:
    table = np.random.default_rng(1).normal(size=(5, 13))
    table[:, 9:] /= np.sqrt((table[:, 9:] ** 2).sum(axis=1, keepdims=True))
    return table


def states(rng: np.random.Generator, batch: tuple[int, ...]) -> MITState:
    """Robots whose joints are anywhere; some of them are told to stand."""
    pose = rng.normal(size=(*batch, 7))
    pose[..., 3:] /= np.sqrt((pose[..., 3:] ** 2).sum(axis=-1, keepdims=True))
    live = {
        ANCHOR_POSE: Extern(pose, 0.0),
        VELOCITY_COMMAND: Extern(rng.uniform(-0.4, 0.4, (*batch, 3)), 0.0),
    }
    joints, vectors = rng.normal(size=(3, *batch, 3)), rng.normal(size=(2, *batch, 3))
    return MITState(0.0, *joints, np.zeros((*batch, 3)), pose[..., 3:], *vectors, live)


def row(state: MITState, i: int) -> MITState:
    live = {name: Extern(value.value[i], 0.0) for name, value in state.extern.items()}
    arrays = [getattr(state, name)[i] for name in list(MITState.__dataclass_fields__)[1:-1]]
    return MITState(0.0, *arrays, live)


def wiring_of(contract: PolicyContract) -> PolicyWiring:
    reference = build_world_reference(contract, frames(), JOINTS, ("torso",))
    return PolicyWiring(JOINTS, contract, reference, EXTERN_WIDTHS, 100.0)


def test_a_robot_by_itself_does_what_the_controller_does() -> None:
    rng, wiring, seen = np.random.default_rng(0), wiring_of(contract()), []

    def policy(observation: Any, frame: int) -> Any:
        seen.append((observation.copy(), frame))
        return actions[len(seen) - 1]

    actions = rng.normal(size=(STEPS, 2)).astype(np.float32)
    controller = RLPolicyController(JOINTS, wiring.contract, wiring.reference, policy, 0.02, extern=EXTERN_WIDTHS)
    first = states(rng, ())
    controls, memory = controller.activate(TickInput(first)), wiring.activate(first)
    for step in range(STEPS):
        state = first if step == 0 else states(rng, ())
        assert isinstance(controls, RLPolicyMemory)
        result = controller.update(controls, TickInput(state))
        assert isinstance(result, tuple)
        controls, expected = result
        observation, memory = wiring.observe(memory, state)
        assert memory.frame == seen[-1][1]
        assert observation.tobytes() == seen[-1][0].tobytes()
        memory, command = wiring.act(memory, actions[step])
        for name in ("position", "velocity", "effort", "stiffness", "damping"):
            np.testing.assert_array_equal(getattr(command, name), getattr(expected, name))
        assert (memory.frame, memory.walked) == (controls.policy.frame, controls.policy.walked)
        np.testing.assert_array_equal(memory.history, controls.policy.history)  # type: ignore[arg-type]
    assert len(seen) == STEPS
    assert controls.policy.frame == 4  # the last frame is held
    assert len({observation.tobytes() for observation, _ in seen}) == STEPS


def test_a_batch_does_what_its_robots_do() -> None:
    rng, wiring = np.random.default_rng(2), wiring_of(contract())
    memories: list[PolicyMemory] | None = None
    batch: PolicyMemory | None = None
    for _ in range(STEPS):
        state, actions = states(rng, (ROBOTS,)), rng.normal(size=(ROBOTS, 2)).astype(np.float32)
        batch = wiring.activate(state) if batch is None else batch
        memories = [wiring.activate(row(state, i)) for i in range(ROBOTS)] if memories is None else memories
        observations, batch = wiring.observe(batch, state)
        batch, commands = wiring.act(batch, actions)
        assert observations.shape == (ROBOTS, wiring.layout.width)
        for i in range(ROBOTS):
            observation, memory = wiring.observe(memories[i], row(state, i))
            np.testing.assert_array_equal(observations[i], observation)
            memories[i], command = wiring.act(memory, actions[i])
            np.testing.assert_array_equal(commands.position[i], command.position)
            assert batch.frame[i] == memories[i].frame  # type: ignore[index]


def test_actions_are_accepted_one_by_one() -> None:
    wiring = wiring_of(contract())
    actions = np.array([[1.0, -100.0], [1.0, 100.5], [np.nan, 0.0], [0.0, np.inf]], dtype=np.float32)
    np.testing.assert_array_equal(wiring.accepts(actions), [True, False, False, False])
    assert wiring.accepts(actions[0])
    assert wiring.action_problem(actions[1]) == "action of c is 100.5, expected a magnitude <= 100"
    assert wiring.action_problem(actions[2]) == "action of b is nan, expected a magnitude <= 100"
    assert wiring.action_problem(actions[0]) == ""


@pytest.mark.parametrize(
    ("changes", "takes"),
    [
        ({}, True),
        ({"observation": ("joint_pos",), "phase": None}, False),
        ({"observation": ("joint_pos",)}, True),  # the clock stands while the robot is told to stand
        ({"observation": ("joint_pos", "command_ang_vel"), "phase": None}, True),
        ({"observation": ("command",), "command_names": ("twist",), "phase": None}, True),
        ({"observation": ("command",), "command_names": ("motion",), "phase": None}, False),
    ],
)
def test_whether_the_velocity_command_is_observed(changes: dict[str, Any], takes: bool) -> None:
    assert wiring_of(contract(**changes)).takes_velocity_command is takes


def test_a_contract_that_does_not_fit_the_robot_is_refused() -> None:
    reference = build_world_reference(contract(), frames(), JOINTS, ("torso",))
    with pytest.raises(FieldError, match="anchor pose"):
        PolicyWiring(JOINTS, contract(), reference, {VELOCITY_COMMAND: 3}, 100.0)
    with pytest.raises(FieldError, match="the robot lacks c; the policy lacks d"):
        PolicyWiring(("a", "b", "d"), contract(), reference, EXTERN_WIDTHS, 100.0)
