"""A bus with one of the Lite's motors, as it comes from the factory: the others have no power."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace

from humanoid_sim.hardware.emulation.emulator import Emulator
from humanoid_sim.hardware.emulation.settings import EmulationSettings
from humanoid_sim.hardware.emulation.virtual import VirtualMotors
from humanoid_sim.robots.description import load_robot

FACTORY_ID = 127


@contextmanager
def lone_motors(
    channel: str, motors: Iterable[int] = (3,), settings: EmulationSettings | None = None
) -> Iterator[VirtualMotors]:
    """These motors, by index, with the factory's id; the fourth is the left elbow's rs-00."""
    with VirtualMotors(load_robot("lite"), [channel], settings=settings) as virtual:

        def prepare(emulator: Emulator) -> None:
            for motor, state in enumerate(emulator.motors.states):
                if motor in motors:
                    stored = replace(state.stored, can_id=FACTORY_ID)
                    emulator.motors.states[motor] = replace(state, can_id=FACTORY_ID, stored=stored)
                else:
                    emulator.motors.set_power(motor, False)

        virtual.call(prepare)
        yield virtual


def cycle_power(virtual: VirtualMotors, motor: int = 3) -> None:
    """Switch a motor off and on."""

    def cycle(emulator: Emulator) -> None:
        emulator.motors.set_power(motor, False)
        emulator.motors.set_power(motor, True)

    virtual.call(cycle)
