"""The table of observation terms, and that everything which knows terms works from it: a new term is one entry."""

import sys
from dataclasses import fields, replace
from types import MappingProxyType

import numpy as np
import pytest
from made_up import made_up_run
from rig import contract

from humanoid_sim.controllers import term_kinds
from humanoid_sim.controllers.contract import PhaseRule, PolicyContract
from humanoid_sim.controllers.policy_step import PolicyWiring
from humanoid_sim.controllers.term_kinds import TERM_KINDS, TERM_NAMES, TermKind, term_kind
from humanoid_sim.controllers.term_values import joint_names, referenced_bounds
from humanoid_sim.controllers.terms import Term
from humanoid_sim.doctor.edits import RobotFacts
from humanoid_sim.doctor.hypotheses import singles
from humanoid_sim.envs.spaces import observation_space
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.mit import EXTERN_WIDTHS, MITState
from humanoid_sim.policy.checkpoint import Checkpoint
from humanoid_sim.policy.checks import estimate_findings
from humanoid_sim.policy.describe import term_lines
from humanoid_sim.policy.golden import golden_problem, value_name
from humanoid_sim.policy.loaded_policy import contract_layout, load_policy
from humanoid_sim.policy.motion import Motion
from humanoid_sim.policy.readers.merge import merge
from humanoid_sim.policy.readers.partial import PartialContract, given
from humanoid_sim.robots.description import load_robot

LITE = load_robot("lite")
JOINTS = LITE.joint_names
BODY = "torso"
KEYS = 3


def joint_effort(request):
    return len(JOINTS), lambda context: context.state.joint_effort


NEW = TermKind(
    "joint_torque",
    "torques of the joints, N·m",
    joint_effort,
    bounds=300.0,
    names=("joint_torque", "tau"),
    reads="joint_effort",
    conventions=("sign",),
    task="piano",
    requires="lookahead_steps",
    scales=(1.0, 0.5),
    value_names=joint_names,
)
"""One that the table does not have."""


@pytest.fixture(params=[*TERM_KINDS.values(), NEW], ids=lambda kind: kind.name)
def kind(request, monkeypatch):
    """Each entry of the table, and one more."""
    kinds = MappingProxyType({**TERM_KINDS, NEW.name: NEW})
    names = MappingProxyType({**TERM_NAMES, **dict.fromkeys(NEW.names, NEW.name)})
    for module in [module for name, module in sys.modules.items() if name.startswith("humanoid_sim.")]:
        for name, value in (("TERM_KINDS", kinds), ("TERM_NAMES", names)):
            if name in vars(module):
                monkeypatch.setattr(module, name, value)
    return request.param


def read(kind):
    """What the readers make of a policy that observes the joints, the term, and what the term cannot be without."""
    beside = {"progress": ("motion_body_pos_b",), "key_pressed": ("target_keys",)}.get(kind.name, ())
    values = {
        "joint_names": JOINTS,
        "joint_stiffness": 40.0,
        "joint_damping": 2.0,
        "default_joint_pos": 0.1,
        "observation": (term_name(kind), *beside, *(("joint_vel",) if kind.name != "joint_vel" else ())),
        "action_scale": 0.25,
        "policy_dt": 0.02,
        "phase": PhaseRule(0.8),
        "anchor_body": BODY,
        "body_names": (BODY,),
        "lookahead_steps": (1, 2),
    }
    needless = {"phase", "anchor_body", "body_names", "lookahead_steps"} - {kind.requires}
    needless -= {"body_names"} if beside == ("motion_body_pos_b",) else set()
    partial = PartialContract("test", given("test", {k: v for k, v in values.items() if k not in needless}))
    return merge([partial], "test")


def term_name(kind):
    return (kind.names or (kind.name,))[-1]


def motion(contract):
    rng = np.random.default_rng(0)
    if contract.task_type == "piano":
        return Motion(rng.integers(0, 2, (9, KEYS)).astype(np.float32), (), 0.02, task_type="piano")
    if contract.task_type == "locomotion":
        return None
    if contract.body_names:
        return Motion(rng.normal(size=(9, 9)).astype(np.float32), (BODY,), 0.02)
    frames = rng.normal(size=(9, 2 * len(JOINTS) + 7)).astype(np.float32)
    frames[:, -4:] /= np.linalg.norm(frames[:, -4:], axis=1, keepdims=True)
    return Motion(frames, (BODY,), 0.02, layout="joints_bodies_w", joint_names=JOINTS)


def policy(observation, _):
    return np.full(len(JOINTS), np.tanh(observation.sum()), dtype=np.float32)


def loaded(kind):
    made = read(kind)
    return load_policy(made, policy, motion(made))


def test_a_name_means_one_thing():
    assert len(TERM_NAMES) == sum(len(kind.names) or 1 for kind in TERM_KINDS.values())
    assert {term_kind(name).name for name in (*TERM_KINDS, *TERM_NAMES)} == set(TERM_KINDS)
    assert term_kind("wind").meaning == "live input"


def test_what_a_kind_says_of_itself_exists(kind):
    known = {field.name for field in fields(MITState)} | {*EXTERN_WIDTHS, "key_pressed", "height_scan", ""}
    assert kind.reads in known
    assert not kind.estimate or kind.reads
    assert {*kind.conventions} - {"sign"} <= {field.name for field in fields(Term)}
    assert kind.requires in {field.name for field in fields(PolicyContract)} | {""}


@pytest.mark.parametrize(
    ("changes", "takes"),
    [
        ({"observation": ("joint_pos",)}, False),
        ({"observation": ("joint_pos", "velocity_commands")}, True),
        ({"observation": (Term("twist", kind="velocity_command"),)}, True),
        # mjlab and Isaac Lab call motion and velocity commands alike; command_names tells which it is.
        ({"observation": ("command",), "command_names": ("twist",)}, True),
        ({"observation": ("command",), "command_names": ("motion",)}, False),
        # The clock stands still at a zero command.
        ({"observation": ("joint_pos",), "phase": PhaseRule(0.8, np.zeros(2), standing_threshold=0.1)}, True),
    ],
)
def test_a_policy_takes_a_velocity_command(changes, takes):
    assert contract(**changes).takes_velocity_command is takes


def test_the_readers_know_what_the_term_is_called_and_needs(kind):
    made = read(kind)
    assert made.kind(made.terms[0]).name == kind.name
    assert made.task_type == (
        kind.task or {"progress": "tracking", "key_pressed": "piano"}.get(kind.name, "locomotion")
    )
    if kind.requires:
        values = given("test", {"observation": (term_name(kind),)})
        with pytest.raises(InputError, match=kind.requires):
            merge([PartialContract("test", values)], "test")


def test_it_is_described(kind):
    made = read(kind)
    line = term_lines(made, contract_layout(made))[0]
    assert line.name == term_name(kind)
    assert line.meaning.startswith(kind.meaning)


def test_its_bounds_hold_it(kind):
    made = loaded(kind)
    wiring = PolicyWiring(JOINTS, made.contract, made.reference, made.extern)
    space = observation_space(wiring, LITE)
    run = made_up_run(Checkpoint(made.contract, policy, "test"), motion(made.contract))
    width = wiring.layout.terms[0].width
    inside = np.abs(run.arrays["observation"][:, :width]) <= np.maximum(np.abs(space.low), np.abs(space.high))[:width]
    assert inside.all()
    assert (space.low < space.high).all()
    if kind.bounds is referenced_bounds:  # not so wide that a learner which scales by them sees nothing
        table = made.reference.terms[kind.name]
        np.testing.assert_allclose(space.high[:width], max(1.0, np.abs(table).max()), rtol=0.01)


def test_the_check_says_what_it_needs_an_estimator_for(kind):
    findings = [str(finding) for finding in estimate_findings(read(kind), hardware=True)]
    assert len(findings) == bool(kind.estimate)
    assert all(kind.estimate in finding and term_name(kind) in finding for finding in findings)


def test_golden_vectors_hold_it(kind):
    made = read(kind)
    checkpoint = Checkpoint(made, policy, "test")
    assert golden_problem(checkpoint, made_up_run(checkpoint, motion(made))) == ""
    layout = loaded(kind).layout
    named = value_name(layout, made, 0)
    joints = kind.value_names(made.terms[0], made)
    assert named == f"{term_name(kind)}[0]" + (f" ({joints[0]})" if joints else "")


def test_the_doctor_turns_its_conventions_round(kind):
    made = read(kind)
    ones = np.ones(len(JOINTS))
    found = [h.contract.terms[0] for h in singles(made, RobotFacts(JOINTS, JOINTS, 80 * ones, 40 * ones, ones, ones))]
    first = made.terms[0]
    same = [term for term in found if term.name == first.name]
    for convention in kind.conventions:
        if convention == "sign":
            assert any(np.all(term.scale == -first.scale) for term in same)
        elif convention == "relative":
            assert any(kind.is_relative(term) != kind.is_relative(first) for term in same)
        else:
            others = {getattr(term, convention) for term in same} - {getattr(first, convention)}
            assert others == ({not first.inverse} if convention == "inverse" else set(first.others(convention)))
    assert {float(term.scale) for term in same if np.ndim(term.scale) == 0} >= {*kind.scales, 0.0}


def test_what_stands_for_a_command_is_said_by_the_contract():
    made = read(TERM_KINDS["joint_pos"])
    assert term_kinds.term_kind("command", ("twist",)).name == "velocity_command"
    with pytest.raises(FieldError, match="'command': the contract has no command_names, expected what it stands for"):
        contract_layout(replace(made, observation=("command",)))


def test_whose_velocity_is_observed():
    terms = (
        Term("base_lin_vel"),
        Term("a", kind="base_lin_vel", at="imu"),
        Term("b", kind="base_lin_vel", at="hand"),
        Term("c", kind="base_lin_vel", at="imu"),
        Term("joint_pos", at="foot"),  # whose positions have no such convention
    )
    made = replace(read(TERM_KINDS["joint_pos"]), observation=terms)
    assert made.velocity_points == ("imu", "hand")
    assert dict(made.extern_widths) == {
        **EXTERN_WIDTHS,
        "base_linear_velocity_at_imu": 3,
        "base_linear_velocity_at_hand": 3,
    }
    assert terms[0].others("at") == ("imu",)
    assert terms[2].others("at") == ("base",)
    with pytest.raises(FieldError, match=r"term 'a': at is '', expected base, imu or the name of a site$"):
        Term("a", at="")
