"""Gamepad buttons to intents: bindings as data, Xbox layout by default."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import permutations

from humanoid_sim.errors import FieldError
from humanoid_sim.messages import Intent


@dataclass(frozen=True, slots=True)
class JoyBindings:
    """Button indices as in `sensor_msgs/Joy`: A 0, B 1, X 2, Y 3, L1 4, R1 5, BACK 6, START 7."""

    damp_button: int = 2
    quit_button: int = 6
    load_combo_a: tuple[int, ...] = (4, 0)
    load_combo_b: tuple[int, ...] = (4, 1)
    start_combo_locomotion: tuple[int, ...] = (5, 0)
    start_combo_remote: tuple[int, ...] = (5, 1)

    def __post_init__(self) -> None:
        combos = self.combos()
        for name, combo in combos.items():
            if not combo or min(combo) < 0 or len(set(combo)) != len(combo):
                raise FieldError(f"JoyBindings.{name}: is {combo}, expected button indices >= 0, each once")
        for first, second in permutations(combos, 2):
            if set(combos[first]) <= set(combos[second]):
                other = f"{combos[first]} is pressed whenever {second} {combos[second]} is"
                raise FieldError(f"JoyBindings.{first}: {other}, expected combinations that exclude each other")

    def combos(self) -> dict[str, tuple[int, ...]]:
        """Return the buttons of each field, all of which must be down."""
        return {name: (value,) if isinstance(value, int) else value for name, value in asdict(self).items()}

    def check(self, button_count: int) -> None:
        """Raise `FieldError` if a gamepad lacks a bound button: an operator must not find out while pressing DAMP."""
        for name, combo in self.combos().items():
            if max(combo) >= button_count:
                raise FieldError(f"JoyBindings.{name}: is {combo}, expected the {button_count} buttons A 0 to START 7")


def pressed_intents(
    bindings: JoyBindings, buttons: Sequence[bool | int], before: Sequence[bool | int]
) -> tuple[Intent, ...]:
    """Return the intents whose last missing button went down between two readings of the buttons.

    Holding a combination does not repeat it. A gamepad that was just connected has `before = ()`: of buttons that are
    already down only those of DAMP count.
    """
    intents = (Intent.DAMP, Intent.QUIT, Intent.LOAD_A, Intent.LOAD_B, Intent.START_LOCOMOTION, Intent.START_REMOTE)
    now = {i for i, down in enumerate(buttons) if down}
    then = {i for i, down in enumerate(before) if down}
    combos = zip(intents, map(set, bindings.combos().values()), strict=True)
    pressed = [intent for intent, combo in combos if combo <= now and not combo <= then]
    return tuple(intent for intent in pressed if before or intent is Intent.DAMP)
