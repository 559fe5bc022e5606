"""Play a song: press the keys that it asks for, and no others."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import ClassVar

import mujoco
import numpy as np

from humanoid_sim.controllers.rotation import rotate
from humanoid_sim.envs.tasks.task import BoolArray, Task
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.errors import total
from humanoid_sim.evaluation.step import StepSample
from humanoid_sim.mit import KEY_PRESSED, FloatArray
from humanoid_sim.robots.piano import KEY_COUNT, is_white, key_joint_names
from humanoid_sim.robots.schema import RobotDescription
from humanoid_sim.simulation.model import base_body, build_model

_REACH = 0.05
"""m"""
_FROM_EDGE = {True: 0.012, False: 0.010}
"""m from the front edge at which white keys are struck, and black ones: over white keys is then only the tip."""
_WRIST_HEIGHT = 0.05
"""m above the white keys, below which a wrist is too low: the forearm would come onto the keys."""


class PianoTask(Task):
    """Hold down the keys that the song asks for in each step, to the song's end. Nothing terminates it.

    ============ ======= ==== =================================================================================
    term         weight  unit value
    ============ ======= ==== =================================================================================
    keys_hit     0.5     1    share of the song's present keys that are down; 1 where it asks for none
    no_wrong_key 0.5     1    1 where no other key is down
    reach        0.25    1    mean over the song's keys of exp(-d²/0.05² m²), d from the key to the nearest fingertip
    energy       -0.0005 W    mechanical power of the motors, the sum of its magnitudes
    low_wrist    -5.0    m    how far wrists are less than 0.05 m above the white keys, summed over both
    ============ ======= ==== =================================================================================

    The first two are the key press reward of RoboPianist (Zakka et al. 2023), for keys that are down or not; `energy`
    is its energy cost, and `low_wrist` is in the place of its cost of forearms that touch.
    """

    FOLLOWS_MOTION = True
    REFERENCE = "target_keys"
    WEIGHTS: ClassVar[Mapping[str, float]] = MappingProxyType(
        {"keys_hit": 0.5, "no_wrong_key": 0.5, "reach": 0.25, "energy": -0.0005, "low_wrist": -5.0, **Task.WEIGHTS}
    )

    def _prepare(self, description: RobotDescription) -> None:
        piano = description.piano
        if piano is None:
            raise InputError(f"{description.name}: has no piano, expected a robot with one, such as lite_piano")
        model = build_model(description, scene=False)
        sites = [model.site(name).id for name in piano.fingers]
        self.bodies = tuple(model.body(wrist).name for wrist in model.site_bodyid[sites])
        self._tips = model.site_pos[sites].copy()
        """Shape (2, 3), m, frames of the wrists: the middles of the round tips."""
        self._strike_points = _strike_points(model, description)
        self._song = self.reference.terms["target_keys"] > 0.5
        if self._song.shape[1] != len(self._strike_points):
            raise InputError(f"motion: has {self._song.shape[1]} keys, and the piano {len(self._strike_points)}")
        self._lowest = float(self._strike_points[:, 2].min()) + _WRIST_HEIGHT

    def _measure(self, sample: StepSample) -> tuple[dict[str, FloatArray], BoolArray]:
        pressed = sample.state.extern[KEY_PRESSED].value > 0.5
        wanted = self._song[self.reference.clamp(sample.frame)]
        hits, asked = (wanted & pressed).sum(axis=-1), wanted.sum(axis=-1)
        wrists, turned = sample.body_position[..., -2:, :], sample.body_quaternion[..., -2:, :]
        tips = wrists + rotate(turned, self._tips)
        offset = tips[..., None, :, :] - self._strike_points[:, None, :]
        nearest = total(offset * offset).min(axis=-1)
        reach = np.where(wanted, np.exp(nearest / -(_REACH**2)), 0.0)
        power = np.abs(sample.torque * sample.state.joint_velocity)
        values: dict[str, FloatArray] = {
            "keys_hit": np.where(asked > 0, hits / np.maximum(asked, 1), 1.0),
            "no_wrong_key": np.where((pressed & ~wanted).any(axis=-1), 0.0, 1.0),
            "reach": np.where(asked > 0, total(reach) / np.maximum(asked, 1), 1.0),
            "energy": total(power),
            "low_wrist": total(np.maximum(self._lowest - wrists[..., 2], 0.0)),
        }
        return values, np.zeros(asked.shape, dtype=np.bool_)


def _strike_points(model: mujoco.MjModel, description: RobotDescription) -> FloatArray:
    """Return where released keys are struck: shape (88, 3), m, frame of the robot's base."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    bodies = [int(model.joint(name).bodyid[0]) for name in key_joint_names()]
    struck: FloatArray = model.geom_size[model.body_geomadr[bodies]] * (1.0, 0.0, 1.0)  # the middle of the front edge
    struck[:, 0] -= [_FROM_EDGE[is_white(key)] for key in range(KEY_COUNT)]
    base = base_body(model, description)
    turn = data.xmat[bodies].reshape(-1, 3, 3)
    world = data.xpos[bodies] + np.einsum("kij,kj->ki", turn, struck) - data.xpos[base]
    points: FloatArray = world @ data.xmat[base].reshape(3, 3)
    return points
