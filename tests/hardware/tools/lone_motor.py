"""A bus with one of the Lite's motors, as it comes from the factory: the others have no power."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import MappingProxyType

from humanoid_sim.hardware.mock.motors import MockMotors
from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.robots.description import load_robot


@contextmanager
def lone_motors(
    channel: str, motors: Sequence[int] = (3,), homing_offset: Mapping[str, float] = MappingProxyType({})
) -> Iterator[MockServer]:
    """These motors, by index, with the factory's id; the fourth is the left elbow's rs-00."""
    lite = load_robot("lite")
    alone = lite.joint_names[motors[0]]
    with MockServer(lite, [channel], homing_offset=homing_offset, alone=alone) as virtual:
        for motor in motors[1:]:
            cycle_power(virtual, motor)
        yield virtual


def cycle_power(virtual: MockServer, motor: int = 3) -> None:
    """Switch a motor off and on."""

    def cycle(mock: MockMotors) -> None:
        mock.set_power(motor, False)
        mock.set_power(motor, True)

    virtual.call(cycle)
