"""What is tried before anything random: every mode for long, and in every mode every safety report and all intents."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import replace
from itertools import chain, product

from humanoid_sim.messages import Intent, SafetyFlag, SafetyLevel, SafetyStatus, TickInput
from humanoid_sim.testing.checks import SafetyViolationError
from humanoid_sim.testing.healthy import healthy_tick
from humanoid_sim.testing.machine import StackMachine
from humanoid_sim.testing.properties import REMOTE

_WAYS = (
    (),
    (Intent.DAMP,),
    (Intent.LOAD_A,),
    (Intent.LOAD_B,),
    (Intent.LOAD_A, Intent.START_LOCOMOTION),
    (Intent.LOAD_A, Intent.START_REMOTE),
)
"""How an operator comes into each mode."""
_SOURCES = ("can0", "can1", "simulator")
_INTENTS_AT_ONCE = 3


def every_mode_lasts(machine_type: type[StackMachine], ticks: int) -> None:
    """Each mode on a healthy robot, for so many ticks: it stays, and no controller fails.

    Raises:
        SafetyViolationError: with the mode and the tick.
    """
    for machine, way in _modes(machine_type):
        try:
            machine.pass_time(ticks)
            if machine.memory.controller == REMOTE:
                machine.pass_time(ticks, sends=False)
        except AssertionError as error:
            raise SafetyViolationError(f"{error}; after {way}, without any attack") from error


def every_report_and_intent(machine_type: type[StackMachine]) -> None:
    """In each mode every level and flag, from every one of up to three sources, and up to three intents in any order.

    Each is one tick on a healthy robot, from the same instant of the mode.

    Raises:
        SafetyViolationError: with the mode and the property that does not hold.
    """
    for machine, way in _modes(machine_type):
        machine.tick()
        state = healthy_tick(machine.robot.position, machine.time + machine.period, externs=machine.externs).state
        given = TickInput(state, remote=machine.remote)
        reports = (replace(given, safety=safety) for safety in _reports())
        wanted = (replace(given, intents=intents) for intents in _intents())
        for one in chain(reports, wanted):
            try:
                _try_out(machine, one)
            except AssertionError as error:
                asked = [intent.name for intent in one.intents] or one.safety
                raise SafetyViolationError(f"{error}; after {way} on a healthy robot, with {asked}") from error


def _modes(machine_type: type[StackMachine]) -> Iterator[tuple[StackMachine, str]]:
    """A machine in each mode that the stack has, and how it came there."""
    for way in _WAYS:
        name = ", ".join(intent.name for intent in way) or "the start"
        machine = machine_type()
        try:
            if way == (Intent.DAMP,):
                machine.tick(Intent.DAMP)
            elif way and not machine.go(*way):
                continue
        except AssertionError as error:
            raise SafetyViolationError(f"{error}; after {name}, without any attack") from error
        yield machine, name


def _reports() -> Iterator[tuple[SafetyStatus, ...]]:
    """One source of one, two or three reports something; the others are well."""
    for count in range(1, len(_SOURCES) + 1):
        for speaker, level, flag in product(range(count), SafetyLevel, SafetyFlag):
            report = SafetyStatus(level, flag, _SOURCES[speaker], "reported")
            well = [SafetyStatus(SafetyLevel.OK, SafetyFlag.NONE, source, "") for source in _SOURCES[:count]]
            yield (*well[:speaker], report, *well[speaker + 1 :])


def _intents() -> Iterator[tuple[Intent, ...]]:
    return chain.from_iterable(product(Intent, repeat=count) for count in range(1, _INTENTS_AT_ONCE + 1))


def _try_out(machine: StackMachine, given: TickInput) -> None:
    """One tick that is checked like any other, and taken back."""
    trial = copy.copy(machine)
    trial.properties, trial.robot, trial.history = machine.properties.copy(), copy.copy(machine.robot), []
    trial.feed(given)
