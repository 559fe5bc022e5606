"""Gamepad buttons to intents: bindings as data, Xbox layout by default."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

from humanoid_sim.errors import FieldError

if TYPE_CHECKING:
    from humanoid_sim.messages import Intent

_FIELDS: Mapping[str, str] = MappingProxyType(
    {
        "DAMP": "damp_button",
        "QUIT": "quit_button",
        "LOAD_A": "load_combo_a",
        "LOAD_B": "load_combo_b",
        "START_LOCOMOTION": "start_combo_locomotion",
        "START_REMOTE": "start_combo_remote",
    }
)
"""Field of `JoyBindings` for each intent, by its name."""


@dataclass(frozen=True, slots=True)
class JoyBindings:
    """Button indices as in `sensor_msgs/Joy`: A 0, B 1, X 2, Y 3, L1 4, R1 5, BACK 6, START 7."""

    damp_button: int = 2
    """DAMP."""
    quit_button: int = 6
    """QUIT."""
    load_combo_a: tuple[int, ...] = (4, 0)
    """LOAD_A, all buttons down."""
    load_combo_b: tuple[int, ...] = (4, 1)
    """LOAD_B."""
    start_combo_locomotion: tuple[int, ...] = (5, 0)
    """START_LOCOMOTION."""
    start_combo_remote: tuple[int, ...] = (5, 1)
    """START_REMOTE."""

    def __post_init__(self) -> None:
        for field in ("load_combo_a", "load_combo_b", "start_combo_locomotion", "start_combo_remote"):
            value = getattr(self, field)
            if isinstance(value, str) or not isinstance(value, Sequence):
                raise FieldError(f"JoyBindings.{field}: is {value!r}, expected a list of button indices")
            object.__setattr__(self, field, tuple(value))
        combos = self._by_name()
        for name, combo in combos.items():
            if not combo or any(isinstance(b, bool) or not isinstance(b, int) or b < 0 for b in combo):
                raise FieldError(f"JoyBindings.{_FIELDS[name]}: is {combo}, expected button indices >= 0")
            if len(set(combo)) != len(combo):
                raise FieldError(f"JoyBindings.{_FIELDS[name]}: is {combo}, expected each button once")
        for first, second in ((a, b) for a in combos for b in combos if a is not b):
            if set(combos[first]) <= set(combos[second]):
                raise FieldError(
                    f"JoyBindings.{_FIELDS[first]}: {combos[first]} is pressed whenever {_FIELDS[second]} "
                    f"{combos[second]} is, expected combinations that exclude each other"
                )

    def combos(self) -> dict[Intent, tuple[int, ...]]:
        """Return the buttons of each intent, all of which must be down."""
        from humanoid_sim.messages import Intent  # noqa: PLC0415 - NumPy stays out of `play --help`

        return {Intent[name]: combo for name, combo in self._by_name().items()}

    def _by_name(self) -> dict[str, tuple[int, ...]]:
        values = {intent: getattr(self, name) for intent, name in _FIELDS.items()}
        return {intent: value if isinstance(value, tuple) else (value,) for intent, value in values.items()}

    def check(self, button_count: int) -> None:
        """Refuse a gamepad that lacks a bound button: an operator must not find out while pressing DAMP.

        Raises `FieldError` naming the binding and the buttons that exist.
        """
        known = f"buttons 0 to {button_count - 1}" if button_count > 0 else "no buttons"
        for intent, combo in self.combos().items():
            if max(combo) >= button_count:
                raise FieldError(f"JoyBindings.{_FIELDS[intent.name]}: is {combo}, but the gamepad has {known}")


def pressed_intents(
    bindings: JoyBindings, buttons: Sequence[bool | int], before: Sequence[bool | int]
) -> tuple[Intent, ...]:
    """Return the intents whose last missing button went down between two readings of the buttons.

    Holding a combination does not repeat it. A gamepad that was just connected has `before = ()`: whatever is already
    held down is not taken for a press, except DAMP.
    """
    now = {i for i, down in enumerate(buttons) if down}
    then = {i for i, down in enumerate(before) if down}
    intents = []
    for intent, combo in bindings.combos().items():
        held = set(combo) <= now
        was_held = set(combo) <= then
        if held and not was_held and (len(before) > 0 or intent.name == "DAMP"):
            intents.append(intent)
    return tuple(intents)
