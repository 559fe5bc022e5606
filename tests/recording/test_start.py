import json
import math

import numpy as np
import pytest

from humanoid_sim.controllers.guards import GuardMemory
from humanoid_sim.controllers.policy_step import PolicyMemory
from humanoid_sim.controllers.reference import Alignment
from humanoid_sim.controllers.remote_policy import RemoteMemory
from humanoid_sim.controllers.rl_policy import RLPolicyMemory
from humanoid_sim.controllers.supervisor import SupervisorMemory
from humanoid_sim.errors import InputError
from humanoid_sim.messages import PolicyStep, SessionHeader
from humanoid_sim.mit import MITCommand
from humanoid_sim.recording.start import START_DOCUMENT, start_document, start_memory


def header(text):
    return SessionHeader("lite", ("a",), 0.02, 0, {START_DOCUMENT: text})


def test_a_policys_memory_comes_back_bit_for_bit():
    random = np.random.default_rng(3)
    policy = PolicyMemory(
        7,
        random.random(2, dtype=np.float32),
        random.random((3, 4), dtype=np.float32),
        np.float64(0.1),
        Alignment(random.random(4), random.random(3)),
    )
    step = PolicyStep(7, np.array([-0.0, 1e-40], dtype=np.float32), np.array([2.0], dtype=np.float32))
    own = RLPolicyMemory(policy=policy, held_ticks=3, command=MITCommand(*random.random((5, 2))), policy_step=step)
    guards = GuardMemory(1.5, -np.ones((3, 2)), np.ones(2), np.zeros(2))
    memory = start_memory(header(start_document(SupervisorMemory("rl_policy_controller", own, "said", guards))))
    assert (memory.controller, memory.status_message) == ("rl_policy_controller", "said")
    back = memory.controller_memory
    assert isinstance(back, RLPolicyMemory)
    assert (back.held_ticks, back.policy.frame, back.policy.walked) == (3, 7, 0.1)
    assert back.policy.history.tobytes() == policy.history.tobytes()
    assert back.policy.history.shape == (3, 4)
    assert back.policy.alignment.offset.tobytes() == policy.alignment.offset.tobytes()
    assert back.policy_step.observation.tobytes() == step.observation.tobytes()
    assert back.command.damping.tobytes() == own.command.damping.tobytes()
    assert memory.guards.held.tolist() == [[-1.0, -1.0]] * 3


def test_what_is_not_a_number_stays_so():
    document = start_document(SupervisorMemory("remote_policy_controller", RemoteMemory(age=math.inf)))
    memory = start_memory(header(document))
    assert memory.controller_memory.age == math.inf
    assert math.isnan(memory.controller_memory.stamp)


def test_a_run_from_its_beginning_has_none():
    assert start_memory(SessionHeader("lite", ("a",), 0.02, 0, {})) is None


@pytest.mark.parametrize(
    "document",
    [
        [],
        3,
        {"type": "Memory"},
        {"type": "os"},
        {"type": "SupervisorMemory"},
        {"type": "array", "dtype": "O", "shape": [1], "data": ""},
        {"type": "SupervisorMemory", "controller": "x", "controller_memory": {"type": "float"}},
        {"type": "SupervisorMemory", "controller": "x", "controller_memory": None},
        {"type": "SupervisorMemory", "controller": [], "controller_memory": None},
        {
            "type": "SupervisorMemory",
            "controller": "damping_controller",
            "controller_memory": {
                "type": "DampingMemory",
                "command": {"type": "MITCommand"}
                | dict.fromkeys(("position", "velocity", "effort", "stiffness", "damping"), "x"),
            },
        },
        {
            "type": "SupervisorMemory",
            "controller": "damping_controller",
            "controller_memory": {"type": "array", "dtype": "<f8", "shape": [2], "data": "AAAA"},
        },
    ],
)
def test_a_document_that_is_none(document):
    with pytest.raises(InputError, match="its header's 'start' is damaged"):
        start_memory(header(json.dumps(document)))


def test_a_foreign_controllers_memory_is_refused():
    with pytest.raises(TypeError, match="memory holds a set"):
        start_document(SupervisorMemory("x", {1}))
