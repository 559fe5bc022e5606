"""Keys of a piano that light up: those that are down, right or wrong, and those that should be and are not."""

from __future__ import annotations

from collections.abc import Iterable

import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.rendering.piano_roll import HIT, MISSED, WRONG, rgb
from humanoid_sim.rendering.piano_sound import Stroke
from humanoid_sim.robots.piano import KEY_COUNT, key_joint_names

__all__ = ["KeyLights"]


class KeyLights:
    """Colours of a model's keys. A model without a piano has none, and nothing happens.

    The colours are the piano roll's; while no song is played every key that is down is right.
    """

    def __init__(self, model: mujoco.MjModel, goals: npt.NDArray[np.bool_] | None = None) -> None:
        """Find the keys, and note their own colours.

        Args:
            model: to be drawn; its `geom_rgba` is written.
            goals: shape (F, 88), whether a key should be down in a frame; None without a song.
        """
        self._model, self._goals = model, goals
        joints = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name) for name in key_joint_names()]
        bodies = [model.jnt_bodyid[joint] if joint >= 0 else -1 for joint in joints]
        self._geoms = [np.flatnonzero(model.geom_bodyid == body).tolist() for body in bodies]
        self._own = []
        for geoms in self._geoms:
            for geom in geoms:
                material = int(model.geom_matid[geom])
                if material >= 0:  # which would hide the geom's own colour
                    model.geom_rgba[geom] = model.mat_rgba[material]
                    model.geom_matid[geom] = -1
            self._own.append([model.geom_rgba[geom].copy() for geom in geoms])
        self._down = np.zeros(KEY_COUNT, dtype=np.bool_)

    def show(self, strokes: Iterable[Stroke], frame: int | None = None) -> None:
        """Take what happened to the keys since the last picture, and the frame of the song that is shown, if any is."""
        for stroke in strokes:
            self._down[stroke.key] = stroke.is_down
        wanted = self._down
        if self._goals is not None and frame is not None:
            wanted = self._goals[min(frame, len(self._goals) - 1)]
        for key, geoms in enumerate(self._geoms):
            colour = _COLOURS.get((bool(self._down[key]), bool(wanted[key])))
            for geom, own in zip(geoms, self._own[key], strict=True):
                self._model.geom_rgba[geom] = own if colour is None else (*colour, 1.0)


_COLOURS = {(True, True): rgb(HIT), (True, False): rgb(WRONG), (False, True): rgb(MISSED)}
"""By whether a key is down, and whether it should be."""
