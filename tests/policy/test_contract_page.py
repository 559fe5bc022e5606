"""docs/contract.md says what the schema accepts: its examples are read, its tables are complete."""

import re
from dataclasses import fields
from pathlib import Path

import pytest
import yaml
from published import HOLOSOMA_REST

from humanoid_sim.controllers.contract import PhaseRule
from humanoid_sim.controllers.term_kinds import TERM_KINDS, TERM_NAMES
from humanoid_sim.controllers.terms import Term
from humanoid_sim.policy.readers.contract_yaml import ContractFile, TermOptions, parse_contract
from humanoid_sim.policy.readers.merge import merge

PAGE = (Path(__file__).parents[2] / "docs" / "contract.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)


def test_there_are_examples():
    assert len(EXAMPLES) == 9


@pytest.mark.parametrize("text", EXAMPLES)
def test_every_example_is_read(text):
    partials = parse_contract(yaml.safe_load(text), "docs/contract.md", "contract.yaml")
    assert partials[-1].fields or partials[-1].terms


def test_the_example_without_any_other_source_is_a_whole_contract():
    contract = merge(parse_contract(yaml.safe_load(EXAMPLES[7]), "docs/contract.md", "contract.yaml"), "policy.onnx")
    assert (len(contract.joint_names), contract.action_count, contract.policy_dt) == (14, 12, 0.04)
    assert contract.terms[-1].kind == "gait_phase"


def test_the_published_policys_example_is_the_one_that_is_tested():
    shown, tested = yaml.safe_load(EXAMPLES[5]), yaml.safe_load(HOLOSOMA_REST)
    assert tested["phase"].pop("offsets") == [0.0, 3.141592653589793]  # the page leaves out what is the default
    assert shown == tested


@pytest.mark.parametrize(
    "names",
    [
        ContractFile.__struct_fields__,
        TermOptions.__struct_fields__,
        [field.name for field in fields(PhaseRule)],
        sorted(TERM_NAMES),
        sorted(TERM_KINDS),
    ],
    ids=["fields", "options", "phase", "terms", "kinds"],
)
def test_every_name_is_on_the_page(names):
    assert [name for name in names if f"`{name}`" not in PAGE] == []


def test_the_schema_has_every_option_of_a_term():
    assert {*TermOptions.__struct_fields__, "name"} == {field.name for field in fields(Term)}


def test_the_example_of_a_live_input_declares_one():
    (partial,) = parse_contract(yaml.safe_load(EXAMPLES[1]), "docs/contract.md", "contract.yaml")
    assert {name: given.value for name, given in partial.terms["foot_contact"].items()} == {
        "width": 2,
        "scale": 0.5,
        "topic": "/feet/contact",
        "timeout": 0.2,
    }
