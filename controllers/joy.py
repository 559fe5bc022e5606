"""Gamepad buttons to intents: bindings as data, Xbox layout by default."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import TYPE_CHECKING

from humanoid_sim.errors import FieldError

if TYPE_CHECKING:
    from humanoid_sim.messages import Intent


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
        combos = self._by_field()
        for name, combo in combos.items():
            if not combo or min(combo) < 0 or len(set(combo)) != len(combo):
                raise FieldError(f"JoyBindings.{name}: is {combo}, expected button indices >= 0, each once")
        for first, second in permutations(combos, 2):
            if set(combos[first]) <= set(combos[second]):
                raise FieldError(
                    f"JoyBindings.{first}: {combos[first]} is pressed whenever {second} {combos[second]} is, "
                    "expected combinations that exclude each other"
                )

    def _by_field(self) -> dict[str, tuple[int, ...]]:
        """Return each field's buttons, in the order of the fields."""
        return {
            "damp_button": (self.damp_button,),
            "quit_button": (self.quit_button,),
            "load_combo_a": tuple(self.load_combo_a),
            "load_combo_b": tuple(self.load_combo_b),
            "start_combo_locomotion": tuple(self.start_combo_locomotion),
            "start_combo_remote": tuple(self.start_combo_remote),
        }

    def combos(self) -> dict[Intent, tuple[int, ...]]:
        """Return the buttons of each intent, all of which must be down."""
        from humanoid_sim.messages import Intent  # noqa: PLC0415 - NumPy stays out of `play --help`

        order = (Intent.DAMP, Intent.QUIT, Intent.LOAD_A, Intent.LOAD_B, Intent.START_LOCOMOTION, Intent.START_REMOTE)
        return dict(zip(order, self._by_field().values(), strict=True))

    def check(self, button_count: int) -> None:
        """Refuse a gamepad that lacks a bound button: an operator must not find out while pressing DAMP.

        Raises `FieldError` naming the binding and the buttons that exist.
        """
        known = f"buttons 0 to {button_count - 1}" if button_count > 0 else "no buttons"
        for name, combo in self._by_field().items():
            if max(combo) >= button_count:
                raise FieldError(f"JoyBindings.{name}: is {combo}, but the gamepad has {known}")


def pressed_intents(
    bindings: JoyBindings, buttons: Sequence[bool | int], before: Sequence[bool | int]
) -> tuple[Intent, ...]:
    """Return the intents whose last missing button went down between two readings of the buttons.

    Holding a combination does not repeat it. A gamepad that was just connected has `before = ()`: buttons that are
    already down do not count as pressed, except those of DAMP.
    """
    now = {i for i, down in enumerate(buttons) if down}
    then = {i for i, down in enumerate(before) if down}
    return tuple(
        intent
        for intent, combo in bindings.combos().items()
        if set(combo) <= now and not set(combo) <= then and (len(before) > 0 or intent.name == "DAMP")
    )
