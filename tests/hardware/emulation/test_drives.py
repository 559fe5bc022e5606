"""The MIT law on several motors."""

from __future__ import annotations

import numpy as np

from humanoid_sim.hardware.emulation.drives import MitTargets


def test_the_mit_law_and_its_limit() -> None:
    targets = MitTargets(np.array([17.0, 4.0]))
    targets.position[:] = 1.0, 1.0
    targets.velocity[:] = 0.5, 0.0
    targets.effort[:] = 0.25, 0.0
    targets.stiffness[:] = 10.0, 50.0
    targets.damping[:] = 2.0, 0.0
    torque = targets.torque(np.array([0.8, -0.5]), np.array([0.1, 3.0]))
    np.testing.assert_allclose(torque, [10.0 * 0.2 + 2.0 * 0.4 + 0.25, 4.0], rtol=1e-12)
    targets.release(0)
    np.testing.assert_array_equal(targets.torque(np.array([0.8, 2.5]), np.zeros(2)), [0.0, -4.0])
