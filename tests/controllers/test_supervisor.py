"""The supervisor: construction, and containment of failures."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest
from rig import (
    DAMPING_KD,
    JOINTS,
    PATHS,
    Run,
    supervisor,
)

from humanoid_sim.controllers.base import Memory
from humanoid_sim.controllers.damping import DampingController, ZeroTorqueController
from humanoid_sim.errors import FieldError
from humanoid_sim.messages import Intent, Mode
from humanoid_sim.mit import MITCommand
from humanoid_sim.testing import fingerprint
from humanoid_sim.testing.properties import DAMPING, REMOTE, RL, ZERO
from humanoid_sim.testing.properties import STANDBY_A as A
from humanoid_sim.testing.properties import STANDBY_B as B

NAN, INF = np.nan, np.inf


def test_the_latest_word_stays_until_there_is_another():
    run = Run(supervisor())
    words = [run.step(*intents).control_mode.status_message for intents in ((Intent.LOAD_A,), (), (Intent.DAMP,), ())]
    refused = "LOAD_A refused: requires DAMPING, mode is ZERO_TORQUE"
    assert words == [refused, refused, "DAMP requested", "DAMP requested"]
    output = Run(supervisor()).step(Intent.LOAD_A, Intent.QUIT, Intent.DAMP, Intent.LOAD_A)
    assert output.control_mode.controller_name == DAMPING
    assert not output.quit
    assert output.refusals == ("LOAD_A refused: DAMP came in the same tick", "QUIT refused: DAMP came in the same tick")


@dataclass(frozen=True, eq=False)
class Foreign:
    """A controller from outside the package, which does whatever `behaviour` does."""

    fallback: ClassVar[str | None] = DAMPING
    behaviour: Any
    activation: Any = lambda *_: Memory()
    joints: tuple[str, ...] = JOINTS

    def activate(self, given):
        return self.activation(given)

    def update(self, memory, given):
        return self.behaviour(memory, given)


def explode(*_):
    raise KeyError("gains")


def test_a_bug_in_damping_leads_to_zero_torque_and_one_in_that_leaves_zeros():
    run = Run(supervisor(**{DAMPING: type("Broken", (Foreign,), {"fallback": ZERO})(explode)}))
    output = run.step(Intent.DAMP)
    assert output.control_mode.controller_name == ZERO
    assert output.faults[0].is_bug
    run = Run(supervisor(**{ZERO: type("Broken", (Foreign,), {"fallback": None})(explode)}))
    for _ in range(2):
        output = run.step()
        assert output.control_mode.controller_name == ZERO
        assert fingerprint(output.command) == fingerprint(MITCommand.zeros(3))
        assert output.faults[0].is_bug


def test_keyboard_interrupts_are_not_swallowed():
    def interrupt(*_):
        raise KeyboardInterrupt

    run = Run(supervisor(interrupt))
    run.walk(*PATHS[A])
    with pytest.raises(KeyboardInterrupt):
        run.step(Intent.START_LOCOMOTION)


@pytest.mark.parametrize(
    ("replaced", "message"),
    [
        ({ZERO: None}, "Supervisor.controllers: zero_torque_controller is missing"),
        ({DAMPING: None}, "Supervisor.controllers: damping_controller is missing"),
        ({"dance_controller": ZeroTorqueController(JOINTS)}, "Supervisor.controllers: unknown controller 'dance_contr"),
        (
            {DAMPING: DampingController(("shoulder", "wrist", "elbow"))},
            r"Supervisor.controllers\['damping_controller'\]: joints are shoulder, wrist, elbow, expected shoul",
        ),
        (
            {A: type("Looping", (Foreign,), {"fallback": A})(explode)},
            r"Supervisor.controllers\['standby_controller_a'\]: fallbacks are standby_controller_a -> standby_contr",
        ),
        (
            {A: type("Lost", (Foreign,), {"fallback": "nobody"})(explode)},
            r"Supervisor.controllers\['standby_controller_a'\]: fallbacks are standby_controller_a -> nobody",
        ),
    ],
)
def test_a_stack_that_cannot_be_safe_is_refused(replaced, message):
    with pytest.raises(FieldError, match=f"^{message}"):
        supervisor(**replaced)


def abstract(memory):
    """What the exhaustive search tells apart: who is in control, and how far."""
    inner = memory.controller_memory
    if memory.controller in (A, B):
        return (
            memory.controller,
            "finished" if inner.standby.is_finished else f"segment {inner.standby.current_segment}",
        )
    if memory.controller == RL:
        return RL, "inference due" if inner.held_ticks == 2 else "holding"
    if memory.controller == REMOTE:
        return REMOTE, "passive" if inner.command is None else "has a command"
    return memory.controller, ""


@pytest.mark.parametrize("path", [path for path in PATHS if path != "zero_torque_controller"])
def test_an_absurd_reading_ends_in_damping_not_in_zero_torque(path):
    """Of one joint, above what may be commanded: the other joints are as sound as before."""
    run = Run(supervisor())
    run.walk(*PATHS[path])
    output = run.step(Intent.DAMP, position=(0.4, 1e9, 0.6))
    assert output.control_mode.mode is Mode.DAMPING
    assert not output.faults
    assert output.command.damping.tolist() == DAMPING_KD
