"""What a policy's observation depends on, whatever its terms are called."""

from __future__ import annotations

import numpy as np
import pytest
from rig import contract

from humanoid_sim.controllers.contract import PhaseRule
from humanoid_sim.controllers.sources import takes_velocity_command
from humanoid_sim.controllers.terms import Term


@pytest.mark.parametrize(
    ("changes", "takes"),
    [
        ({"observation": ("joint_pos",)}, False),
        ({"observation": ("joint_pos", "velocity_commands")}, True),
        ({"observation": (Term("twist", kind="velocity_command"),)}, True),
        # mjlab and Isaac Lab call motion and velocity commands alike; command_names tells which it is.
        ({"observation": ("command",), "command_names": ("twist",)}, True),
        ({"observation": ("command",), "command_names": ("motion",)}, False),
        # The clock stands still at a zero command.
        ({"observation": ("joint_pos",), "phase": PhaseRule(0.8, np.zeros(2), standing_threshold=0.1)}, True),
    ],
)
def test_a_policy_takes_a_velocity_command(changes: dict[str, object], takes: bool) -> None:
    assert takes_velocity_command(contract(**changes)) is takes
