"""The public safety properties, and beside them the rig's gains written out: settings are not believed here either."""

import numpy as np
from rig import DAMPING_KD, PASSIVE_KD, POLICY_KD, POLICY_KP

from humanoid_sim.messages import TickInput, TickOutput
from humanoid_sim.testing import SafetyProperties

__all__ = ["RigProperties"]

STANDBY_KP = {"standby_controller_a": [10.0, 11.0, 12.0], "standby_controller_b": [20.0, 21.0, 22.0]}


class RigProperties(SafetyProperties):
    """Of a stack whose controllers can be told apart by their gains alone."""

    limp_damping: list[float] | None = None
    """K_d that REMOTE last obeyed without stiffness; None if what it did last was something else."""

    def check(self, given: TickInput, output: TickOutput) -> None:
        super().check(given, output)
        name, command = output.control_mode.controller_name, output.command
        kp, kd = command.stiffness, command.damping
        assert command.position.shape == (3,)
        if name == "damping_controller":
            assert kd.tolist() == DAMPING_KD
        elif name == "rl_policy_controller":
            assert kp.tolist() == POLICY_KP
            assert kd.tolist() == POLICY_KD
            assert command.position[2] == 0.0
        elif name in STANDBY_KP:
            ramp = kp / np.array(STANDBY_KP[name])
            np.testing.assert_allclose(ramp, ramp[0], rtol=1e-12)
            np.testing.assert_allclose(kd, 0.1 * kp, rtol=1e-12)
        elif name == "remote_policy_controller" and not kp.any():
            sent = given.remote is not None and not given.remote.command.stiffness.any()
            # A command that is refused leaves the one before it in force, until that is too old.
            assert sent or kd.tolist() in (PASSIVE_KD, self.limp_damping)
            self.limp_damping = kd.tolist()
            return
        self.limp_damping = None
