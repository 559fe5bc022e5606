"""The guardian of motors that execute their last command for ever: which need one, and how a session lives with it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence

import numpy as np

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.adapter.wiring import Wiring
from humanoid_sim.hardware.bus.address import BusAddress
from humanoid_sim.hardware.bus.channel import OpenBus
from humanoid_sim.hardware.bus.open_channels import Locks
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.families import DRIVERS
from humanoid_sim.hardware.guardian.guardian import SOURCE, Guardian, can_share
from humanoid_sim.hardware.guardian.protocol import GuardedMotor, GuardianPlan
from humanoid_sim.messages import SafetyStatus
from humanoid_sim.mit import FloatArray


class MotorGuard:
    """A guardian for those of some motors that need one, from one activation to the next; where none does, nothing.

    Before motors are enabled: `start` and `standby`. With every set of commands: `beat`. Before they are disabled:
    `take_back`; after: `release`.
    """

    def __init__(
        self,
        wiring: Wiring,
        addresses: Sequence[BusAddress],
        damping: FloatArray,
        joints: Collection[int] | None = None,
    ) -> None:
        """Start nothing yet; `damping` has shape (n,), N·m·s/rad. Only `joints` will be enabled; None: all."""
        self._wiring = wiring
        self._addresses = addresses
        self._damping = damping
        self._guardian: Guardian | None = None
        self.joints = frozenset(wiring.endless if joints is None else set(wiring.endless) & set(joints))
        """Joints whose motors need one."""

    def start(self, locks: Locks, checks: CheckList, open_bus: OpenBus) -> OpenBus:
        """Start a guardian of this process, if one is needed and can share the channels; returns what opens them now.

        Raises `RobotError` if it cannot be started; with everything else that is wrong.
        """
        if not self.joints:
            return open_bus
        names = ", ".join(self._wiring.names[i] for i in sorted(self.joints))
        if not all(can_share(address) for address in self._addresses):
            checks.warn(SOURCE, f"{names}: emulated in this process, with which they end; no guardian watches them")
            return open_bus
        plan = self._plan()
        try:
            self._guardian = guardian = Guardian(plan, locks.descriptors)
        except RobotError as error:
            checks.problem(SOURCE, str(error))
            checks.refuse()
            raise
        checks.passed(
            SOURCE,
            f"process {guardian.pid} damps {names} for {plan.damping_time:g} s, then resets them, when this program is "
            f"silent for {1000.0 * plan.timeout:g} ms; {guardian.measures}",
        )
        checks.warn(
            SOURCE,
            f"{names} execute their last command for ever where nobody tells them otherwise: if the guardian is killed "
            "as well, the bus fails, or this computer loses its power, only the switch of their supply stops them",
        )
        return guardian.opener(open_bus)

    def _plan(self) -> GuardianPlan:
        """Each family's own frames."""
        wiring, motors = self._wiring, {}
        for family, driver in DRIVERS.items():
            joints = [i for i in wiring.of_family(family) if i in self.joints]
            if not joints:
                continue
            assert driver.rescue is not None, f"{family} has no timeout and nothing for a guardian to send"
            frames = driver.rescue(wiring.select(joints), self._damping[np.array(joints)])
            for i, (damping, reset) in zip(joints, frames, strict=True):
                motors[i] = GuardedMotor(wiring.names[i], self._addresses[wiring.channel[i]], damping, reset)
        return GuardianPlan(tuple(motors[i] for i in sorted(motors)))

    @property
    def drives(self) -> bool:
        """Return whether the guardian has taken over, and has not ended."""
        return self._guardian is not None and self._guardian.drives

    def standby(self) -> None:
        """Motors may be enabled from here on, without torque."""
        if self._guardian is not None:
            self._guardian.standby()

    def beat(self) -> None:
        """Note that a set of commands was handed to every motor."""
        if self._guardian is not None:
            self._guardian.beat()

    def status(self) -> SafetyStatus | None:
        """Return what is to be told about the guardian; none while it watches, and where there is none."""
        return None if self._guardian is None else self._guardian.status()

    def take_back(self, forget_queues: Callable[[], None]) -> None:
        """Be the only master again: nothing is commanded from here on, and a guardian that drives finishes first."""
        if self._guardian is None:
            return
        if self._guardian.drives:
            forget_queues()
            self._guardian.release(confirmed=False)
        else:
            self._guardian.standby()

    def release(self, may_run: Collection[int]) -> None:
        """End the guardian; if motors that it watches did not confirm that they are disabled, it brakes them first."""
        if self._guardian is not None:
            self._guardian.release(confirmed=self.joints.isdisjoint(may_run))
            self._guardian = None
