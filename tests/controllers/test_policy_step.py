"""One policy step: a batch as its robots one by one, bit for bit; actions, their limits, and the gait clock."""

import numpy as np
import pytest
import rig

from humanoid_sim.controllers import policy_step
from humanoid_sim.controllers.contract import PhaseRule, Term
from humanoid_sim.controllers.policy_step import advance_phase
from humanoid_sim.controllers.reference import build_world_reference
from humanoid_sim.mit import ANCHOR_POSE, EXTERN_WIDTHS, VELOCITY_COMMAND, Extern, MITState

STEPS, ROBOTS = 8, 4
WALK, STAND = np.array([0.5, 0.0, 0.0]), np.zeros(3)
TURN = 2.0 * np.pi * 0.02
"""rad that a clock of 1 s advances in one step of 0.02 s."""


def wiring():
    """Everything that has a memory: history, phase, a reference laid onto the robot, the last action."""
    contract = rig.contract(
        observation=(
            Term("joint_pos", history=3),
            Term("projected_gravity", scale=2.0),
            "motion_anchor_pos_b",
            "motion_anchor_ori_b",
            Term("actions", history=2, history_order="newest_first"),
            "gait_phase",
            "velocity_commands",
            "motion_command",
        ),
        command_names=("motion",),
        body_names=("torso",),
        anchor_body="torso",
        phase=PhaseRule(period=0.7, standing_threshold=0.3),
    )
    table = np.random.default_rng(1).normal(size=(5, 13))
    table[:, 9:] /= np.sqrt((table[:, 9:] ** 2).sum(axis=1, keepdims=True))
    reference = build_world_reference(contract, table, rig.JOINTS, ("torso",))
    return policy_step.PolicyWiring(rig.JOINTS, contract, reference, EXTERN_WIDTHS)


def states(rng, batch):
    """Robots whose joints are anywhere; some of them are told to stand."""
    pose = rng.normal(size=(*batch, 7))
    pose[..., 3:] /= np.sqrt((pose[..., 3:] ** 2).sum(axis=-1, keepdims=True))
    live = {ANCHOR_POSE: Extern(pose, 0.0), VELOCITY_COMMAND: Extern(rng.uniform(-0.4, 0.4, (*batch, 3)), 0.0)}
    joints, vectors = rng.normal(size=(3, *batch, 3)), rng.normal(size=(2, *batch, 3))
    return MITState(0.0, *joints, np.zeros((*batch, 3)), pose[..., 3:], *vectors, live)


def row(state, i):
    live = {name: Extern(value.value[i], 0.0) for name, value in state.extern.items()}
    arrays = [getattr(state, name)[i] for name in list(MITState.__dataclass_fields__)[1:-1]]
    return MITState(0.0, *arrays, live)


def test_a_batch_does_what_its_robots_do():
    rng, wired = np.random.default_rng(2), wiring()
    state = states(rng, (ROBOTS,))
    batch, memories = wired.activate(state), [wired.activate(row(state, i)) for i in range(ROBOTS)]
    for _ in range(STEPS):
        actions = rng.normal(size=(ROBOTS, 2)).astype(np.float32)
        observations, batch = wired.observe(batch, state)
        batch, commands = wired.act(batch, actions)
        assert observations.shape == (ROBOTS, wired.layout.width)
        for i in range(ROBOTS):
            observation, memory = wired.observe(memories[i], row(state, i))
            np.testing.assert_array_equal(observations[i], observation)
            memories[i], command = wired.act(memory, actions[i])
            np.testing.assert_array_equal(commands.position[i], command.position)
            assert batch.frame[i] == memories[i].frame
        state = states(rng, (ROBOTS,))


def test_actions_are_accepted_one_by_one():
    wired = wiring()
    actions = np.array([[1.0, -100.0], [1.0, 100.5], [np.nan, 0.0], [0.0, np.inf]], dtype=np.float32)
    np.testing.assert_array_equal(wired.accepts(actions), [True, False, False, False])
    assert wired.accepts(actions[0])
    hint = "action_limit in a contract.yaml raises it"
    assert wired.action_problem(actions[1]) == f"action of shoulder is 100.5, expected a magnitude <= 100: {hint}"
    assert wired.action_problem(actions[2]) == "action of elbow is nan, expected a magnitude <= 100"
    assert wired.action_problem(actions[0]) == ""


def rig_map(**changes):
    """Of a policy that drives the elbow and the shoulder, on a robot with a wrist too."""
    return policy_step.resolve_action(rig.contract(**changes), rig.JOINTS)


LIMITS = [[-0.1, 0.1], [-1.0, 1.0]]


@pytest.mark.parametrize(
    ("changes", "action", "position"),
    [
        ({"action_scale": 2.0}, [1.0, 1.0], [2.03, 2.02, 0.0]),
        # elbow: 0.02 + 0.5 * 1.5, beyond its limit; shoulder: 0.03 + 0.25 * 1.5, within
        ({"action_clip": 1.5, "position_clip": LIMITS}, [9.0, 9.0], [0.03 + 0.25 * 1.5, 0.1, 0.0]),
        ({"position_clip": LIMITS[:1]}, [-9.0, 9.0], [0.1, -0.1, 0.0]),
        ({"action_offset": [0.5, 0.6]}, [0.0, 0.0], [0.6, 0.5, 0.0]),  # replaces the default pose
    ],
)
def test_actions_are_scaled_clipped_and_offset(changes, action, position):
    command = policy_step.action_command(rig_map(**changes), np.array(action, np.float32))
    assert command.position.tolist() == position


def phases(rule, commands):
    walked, shown = 0.0, []
    for command in commands:
        walked, phase = advance_phase(rule, walked, command, 0.02)
        shown.append(phase.tolist())
    return shown


@pytest.mark.parametrize(
    ("options", "commands", "shown"),
    [
        ({}, [WALK, WALK], [[TURN], [2 * TURN]]),
        ({"advance_first": False}, [WALK, WALK], [[0.0], [TURN]]),
        # Standing shows its value and walking on starts again, unless the clock runs on, or standing has no phase.
        ({"standing_threshold": 0.1}, [WALK, STAND, WALK], [[TURN], [np.pi], [TURN]]),
        (
            {"standing_threshold": 0.1, "standing_restarts": False},
            [WALK, STAND, WALK],
            [[TURN], [np.pi], [3 * TURN]],
        ),
        ({"standing_threshold": 0.1, "standing_value": None}, [STAND], [[np.nan]]),
    ],
)
def test_what_the_clock_shows_while_walking_and_standing(options, commands, shown):
    np.testing.assert_allclose(phases(PhaseRule(1.0, [0.0], **options), commands), shown)
