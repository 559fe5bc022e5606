"""The pictures of docs/concepts.md show what the code does."""

import inspect
import re
from dataclasses import fields
from pathlib import Path

import pytest

from humanoid_sim.controllers.base import DAMPING, REMOTE_POLICY, RL_POLICY, STANDBY_A, STANDBY_B, ZERO_TORQUE
from humanoid_sim.controllers.fsm import MODES, transition
from humanoid_sim.controllers.rl_policy import RLPolicyController
from humanoid_sim.controllers.supervisor import Supervisor
from humanoid_sim.messages import OK, Intent, Mode, SafetyLevel, SafetyStatus, TickInput, TickOutput
from humanoid_sim.robots.description import load_robot
from humanoid_sim.stack import build_supervisor

ROOT = Path(__file__).parent.parent.parent
PAGE = (ROOT / "docs" / "concepts.md").read_text(encoding="utf-8")
ARCHITECTURE, MACHINE, TICK = re.findall(r"```mermaid\n(.*?)```", PAGE, re.DOTALL)
ROWS = re.findall(r"^\| (.+?) \| (`.+) \|$", PAGE, re.MULTILINE)

"""From a mode, because of something, to a mode; `START` and `END` stand for the beginning and the end."""


def drawn(picture):
    """The edges of the picture of the state machine; a node with a text is a way that several modes share."""
    node = r"\w+(?:\(.*?\)+)?"
    lines = re.findall(rf'({node}(?: & {node})*) (?:-- "?(.+?)"? -->|-->|---) ({node})', picture)
    shared = dict(re.findall(r'(\w+)\(\["(.+?)"\]\)', picture))
    edges, ways = set(), {}
    for begins, words, end in lines:
        names = [re.match(r"\w+", begin)[0] for begin in begins.split(" & ")]
        target = re.match(r"\w+", end)[0]
        for name in names:
            if target in shared:
                ways.setdefault(target, []).append(name)
            elif name in shared:
                edges |= {(begin, why, target) for begin in ways[name] for why in shared[name].split(", ")}
            else:
                edges |= {(name, why, target) for why in words.split(", ")}
    return edges


def of_the_code():
    """Every change of mode: by an intent, by a safety status, by a fault's fallback."""
    supervisor = build_supervisor(load_robot("lite"), 0.02, None, remote=True)
    fault = SafetyStatus(SafetyLevel.FAULT)
    edges = {("START", "", MODES[supervisor.initial().controller].name)}
    for controller, mode in MODES.items():
        for intent in Intent:
            decision = transition(controller, OK, intent, True, MODES)
            if decision.quit:
                edges.add((mode.name, intent.name, "END"))
            elif decision.controller is not None:
                edges.add((mode.name, intent.name, MODES[decision.controller].name))
        demoted = transition(controller, fault, None, True, MODES).controller
        if demoted is not None:
            edges.add((mode.name, "safety", MODES[demoted].name))
    for controller, configured in {**supervisor.controllers, RL_POLICY: RLPolicyController}.items():
        if configured.fallback is not None:
            edges.add((MODES[controller].name, "fault", MODES[configured.fallback].name))
    return edges


def test_the_state_machine_is_the_code_s():
    assert set(MODES) == {ZERO_TORQUE, DAMPING, STANDBY_A, STANDBY_B, RL_POLICY, REMOTE_POLICY}
    assert drawn(MACHINE) == of_the_code()
    assert len(drawn(MACHINE)) == 18
    assert {name for begin, _, end in drawn(MACHINE) for name in (begin, end)} == {*Mode.__members__, "START", "END"}


def test_a_picture_that_lacks_an_arrow_is_noticed():
    assert drawn(MACHINE.replace("LOAD_A, LOAD_B", "LOAD_A")) != of_the_code()
    assert drawn(MACHINE.replace("STANDBY & LOCOMOTION & REMOTE", "STANDBY & REMOTE")) != of_the_code()


def test_the_picture_of_a_tick_has_every_field():
    for kind in (TickInput, TickOutput):
        words = re.search(rf'\["{kind.__name__}<br>(.+?)"\]', TICK)
        assert words[1].replace("<br>", " ").split(", ") == [field.name for field in fields(kind)]


def test_the_picture_of_a_tick_has_the_steps_in_their_order():
    steps = ["merge_safety", "choose_intent", "transition"]
    source = inspect.getsource(Supervisor.step)
    for text in (source, TICK):
        places = [text.index(step) for step in steps]
        assert places == sorted(places)


@pytest.mark.parametrize(("shown", "code"), ROWS, ids=[shown for shown, _ in ROWS])
def test_what_the_picture_shows_is_in_the_code(shown, code):
    assert shown.partition("'")[0].split()[0] in re.sub(r"<br>", " ", ARCHITECTURE + TICK + PAGE[: PAGE.index("```")])
    for file, name in re.findall(r"`([^`]+\.py)`: `(\w+)`", code):
        assert re.search(rf"^(def|class) {name}\b", (ROOT / file).read_text(encoding="utf-8"), re.MULTILINE)


def test_every_part_in_the_table_is_looked_at():
    assert len(ROWS) == 13
