"""The supervisor: construction, and failures of foreign controllers; `tests/survive` has the transitions."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from rig import DAMPING_KD, JOINTS, PATHS, Run, good_answer, supervisor, two_policies

from humanoid_sim.controllers.base import DAMPING, RL_POLICY, STANDBY_A, ZERO_TORQUE, Fault, Memory
from humanoid_sim.controllers.damping import ZeroTorqueController
from humanoid_sim.errors import FieldError
from humanoid_sim.messages import Intent, Mode
from humanoid_sim.mit import MITCommand
from humanoid_sim.testing.healthy import ScriptedPolicy


def test_another_policy_is_selected_at_rest_and_runs_at_its_own_rate():
    walked, danced = ScriptedPolicy(good_answer), ScriptedPolicy(good_answer)
    run = Run(two_policies(walked, danced))
    output = run.step(Intent.DAMP, policy="dance")
    assert output.control_mode.status_message == "policy dance selected; DAMP requested"
    run.step(Intent.LOAD_A)
    for _ in range(4):
        output = run.step()
    assert "policy dance" in run.step(Intent.START_LOCOMOTION).control_mode.status_message
    assert all(run.step().control_mode.controller_name == RL_POLICY for _ in range(3))
    assert (len(danced.calls), len(walked.calls)) == (4, 0)
    run.step(Intent.DAMP, policy="walk")  # still in LOCOMOTION
    run.walk(Intent.LOAD_B, Intent.START_LOCOMOTION)
    assert (len(danced.calls), len(walked.calls)) == (5, 0)


@pytest.mark.parametrize("mode", PATHS)
@pytest.mark.parametrize(("policy", "reason"), [("dance", "requires ZERO_TORQUE or DAMPING"), ("danse", "known: walk")])
def test_a_selection_is_refused_in_motion_and_of_a_policy_that_is_not_loaded(mode, policy, reason):
    run = Run(two_policies())
    run.walk(*PATHS[mode])
    output = run.step(policy=policy)
    assert output.control_mode.controller_name == mode
    if policy == "dance" and mode in (ZERO_TORQUE, DAMPING):
        assert not output.refusals
    else:
        (refusal,) = output.refusals
        assert refusal.startswith(f"policy {policy} refused: ")
        assert reason in refusal
        assert run.memory.policy == "walk"


@dataclass(frozen=True, eq=False)
class Foreign:
    """A controller from outside the package, which does whatever `behaviour` does."""

    behaviour: Any
    joints: tuple[str, ...] = JOINTS

    def activate(self, given):
        return Memory()

    def update(self, memory, given):
        return self.behaviour(memory, given)


class UnprintableError(Exception):
    def __str__(self):
        raise RuntimeError


def explode_without_a_word(*_):
    raise UnprintableError


@pytest.mark.parametrize(
    ("behaviour", "message"),
    [
        (explode_without_a_word, "UnprintableError: UnprintableError"),
        (lambda *_: Fault("\udc80 is no text"), r"\udc80 is no text"),
        (lambda *_: (None, MITCommand.zeros(3)), "TypeError: update gave a NoneType for a memory"),
    ],
)
def test_any_failure_of_a_foreign_controller_is_damped_and_can_be_recorded(behaviour, message):
    run = Run(supervisor(**{STANDBY_A: Foreign(behaviour)}))
    run.step(Intent.DAMP)
    output = run.step(Intent.LOAD_A)
    assert output.control_mode.mode is Mode.DAMPING
    assert output.faults[0].message.startswith(message)
    assert output.control_mode.status_message.encode()


@pytest.mark.parametrize(
    ("replaced", "message"),
    [
        ({ZERO_TORQUE: None}, "controllers: is without zero_torque_controller"),
        ({DAMPING: None}, "controllers: is without damping_controller"),
        ({"dance_controller": ZeroTorqueController(JOINTS)}, "controllers: unknown controller 'dance_controller'"),
        (
            {DAMPING: ZeroTorqueController(("shoulder", "wrist", "elbow"))},
            r"controllers\['damping_controller'\].joints: is",
        ),
    ],
)
def test_a_stack_that_cannot_be_safe_is_refused(replaced, message):
    with pytest.raises(FieldError, match=rf"^Supervisor\.{message}"):
        supervisor(**replaced)


@pytest.mark.parametrize("count", [1, 4])
@pytest.mark.parametrize("path", [path for path in PATHS if path != DAMPING])
def test_a_state_of_another_robot_ends_in_zero_torque(path, count):
    run = Run(supervisor())
    run.walk(*PATHS[path])
    output = run.step(position=(0.4,) * count)
    assert output.control_mode.mode is Mode.ZERO_TORQUE
    assert output.command.position.tolist() == [0.0, 0.0, 0.0]
    assert all(fault.message == f"state has ({count},) joint positions, expected (3,)" for fault in output.faults)


@pytest.mark.parametrize("reading", [np.nan, -np.inf, 1e6 + 1.0, 1e300])
@pytest.mark.parametrize("path", [path for path in PATHS if path not in (ZERO_TORQUE, DAMPING)])
def test_an_unknown_or_absurd_reading_of_one_joint_makes_no_joint_limp(path, reading):
    run = Run(supervisor())
    run.walk(*PATHS[path])
    output = run.step(Intent.DAMP, position=(0.4, reading, 0.6))
    assert output.control_mode.mode is Mode.DAMPING
    assert not output.faults
    assert output.command.position.tolist() == [0.4, 0.0, 0.6]
    assert output.command.damping.tolist() == DAMPING_KD
