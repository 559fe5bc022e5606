"""What `policy doctor` prints, and writes for programs."""

import json
from dataclasses import replace

import pytest
import yaml
from models import contract_of
from plants import gains_listed, swapped, term, terms_swapped
from rich.console import Console

from humanoid_sim.controllers.contract import PhaseRule, Term
from humanoid_sim.doctor.edits import Edit
from humanoid_sim.doctor.report import compare_contracts, make_document, print_document
from humanoid_sim.doctor.search import Result, Row
from humanoid_sim.errors import InputError
from humanoid_sim.policy_tools import main

JOINTS = ("hip", "knee", "ankle")
RIGHT = contract_of(
    JOINTS,
    joint_stiffness=[40.0, 99.0, 28.5],
    default_joint_pos=[-0.2, 0.4, 0.0],
    observation=[Term("base_ang_vel", scale=0.25), Term("joint_pos"), Term("joint_vel"), Term("actions")],
    phase=PhaseRule(0.8),
)


@pytest.mark.parametrize(
    ("wrong", "shown", "fix"),
    [
        (
            swapped("hip", "knee")(RIGHT),
            {"joint_names: [0] knee -> hip, [1] hip -> knee"},
            {"joint_names": list(JOINTS), "action_joint_names": list(JOINTS)},
        ),
        (replace(RIGHT, policy_dt=0.04), {"policy_dt: 0.04 -> 0.02"}, {"policy_dt": 0.02}),
        (replace(RIGHT, phase=PhaseRule(0.8, advance_first=False)), set(), {"phase": {"advance_first": True}}),
        (term("base_ang_vel", scale=1.0)(RIGHT), set(), {"terms": {"base_ang_vel": {"scale": 0.25}}}),
        (
            terms_swapped("joint_vel", "joint_pos")(RIGHT),
            {"observation: [1] joint_vel -> joint_pos, [2] joint_pos -> joint_vel"},
            {"observation": ["base_ang_vel", "joint_pos", "joint_vel", "actions"]},
        ),
    ],
)
def test_only_what_differs_is_shown_and_written(wrong, shown, fix):
    written, lines = compare_contracts(wrong, RIGHT)
    assert written == fix
    assert shown <= set(lines)


def test_the_verdict_comes_first_and_the_lines_for_the_file_last(tmp_path, capsys):
    wrong = gains_listed(("ankle", "hip", "knee"))(RIGHT)
    edit = Edit("the gains are in another order", "gains", RIGHT)
    result = Result("Most likely the gains", (Row(edit, 0.0, "agrees"),), "as it is it falls", edit)
    document = make_document(wrong, result, tmp_path / "x.contract.yaml")
    assert json.loads(json.dumps(document)) == document
    assert (document["healthy"], document["finding"]) == (False, "gains")
    assert document["fix"] == {"joint_stiffness": [40.0, 99.0, 28.5]}
    print_document(document, Console(width=80))
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "Most likely the gains."
    place = next(i for i, line in enumerate(lines) if line.startswith("# "))
    assert yaml.safe_load("\n".join(lines[place:])) == document["fix"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("lite_biped_velocity", "--robot", "lite_biped", "--motion", "wave"), "motion"),
        (("lite_tracking", "--robot", "lite"), "--motion"),
        (("lite_tracking", "--robot", "nobody"), "nobody"),
        (("lite_biped_velocity", "--robot", "lite_biped", "--trace", "none.npz"), "none.npz"),
    ],
)
def test_bad_options_are_refused(words, message):
    with pytest.raises(InputError, match=message):
        main(["doctor", *words])
