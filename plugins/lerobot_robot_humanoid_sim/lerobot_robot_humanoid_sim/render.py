"""The process that renders a camera: pictures of a session's newest ticks to standard output, as RGB bytes.

Started with the options as JSON. It only reads the session's feed, and draws with OpenGL.
A reader that is slow holds up this process alone.
"""

import json
import os
import sys
import time
from typing import Any

import mujoco
import numpy as np

from humanoid_sim.client import SessionError
from humanoid_sim.errors import InputError
from humanoid_sim.frontends.attach import attached
from humanoid_sim.rendering.offscreen import PoseRenderer
from humanoid_sim.simulation.model import joint_addresses

_WORLD = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
"""Where a robot looks in its initial pose, and which way is up."""
_LOOKAT = 0.5
"""m from the eye to what is looked at."""


class Eye:
    """A camera in front of a body, which turns with it but stays upright."""

    def __init__(self, model: mujoco.MjModel, body: str, pitch: float) -> None:
        """Find the body. Raises `InputError` if there is none."""
        names = [model.body(index).name for index in range(1, model.nbody)]
        found = [name for word in ([body] if body else ["head", "torso", "chest"]) for name in names if word in name]
        if (body and body not in names) or not found:
            raise InputError(f"camera: body '{body or 'head'}' is not in the model; it has: {', '.join(names)}")
        self._model, self._data = model, mujoco.MjData(model)
        self._body = model.body(body or found[0]).id
        mujoco.mj_kinematics(model, self._data)
        turn = self._data.xmat[self._body].reshape(3, 3)
        origin = self._data.xpos[self._body]
        forward, up = _WORLD
        geoms = [g for g in range(model.ngeom) if model.geom_bodyid[g] == self._body]
        places = [self._data.geom_xpos[g] - origin for g in geoms] or [np.zeros(3)]
        front = max(place @ forward for place in places) + max((model.geom_rbound[g] for g in geoms), default=0.0)
        eye = front * forward + np.mean([place @ up for place in places]) * up
        angle = np.radians(pitch)
        self._eye, self._gaze = turn.T @ eye, turn.T @ (np.cos(angle) * forward - np.sin(angle) * up)
        self.camera = mujoco.MjvCamera()
        self.camera.distance = _LOOKAT

    def look(self, qpos: np.ndarray) -> None:
        """Bring the camera to where the body is."""
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        turn = self._data.xmat[self._body].reshape(3, 3)
        gaze = turn @ self._gaze
        self.camera.lookat[:] = self._data.xpos[self._body] + turn @ self._eye + _LOOKAT * gaze
        self.camera.azimuth = np.degrees(np.arctan2(gaze[1], gaze[0]))
        self.camera.elevation = np.degrees(np.arcsin(np.clip(gaze[2], -1.0, 1.0)))


def main(options: dict[str, Any]) -> None:
    """Draw until the session ends or nobody reads."""
    with attached(options["session"], "lerobot camera") as attachment:
        model = attachment.model()
        eye = None
        if options["view"] == "ego":
            eye = Eye(model, options["body"], options["pitch"])
            model.vis.global_.fovy = options["fovy"]
        camera = None if options["view"] == "outside" else options["view"] if eye is None else eye.camera
        pictures = PoseRenderer(lambda: model, options["width"], options["height"], camera)
        number, feed = 0, attachment.feed
        qpos, addresses = model.qpos0.copy(), joint_addresses(model, feed.joint_names).qpos
        while feed.is_running():
            begin = time.monotonic()
            sample = feed.wait(number, 0.5)
            if sample is None:
                continue
            number, tick = sample.number, feed.decode(sample)
            if tick["has_qpos"]:
                qpos[:] = tick["qpos"]
            else:  # motors, which say how the joints are; one that was not heard stays as it was
                known = np.isfinite(tick["joint_position"])
                qpos[addresses[known]] = tick["joint_position"][known]
            if not np.isfinite(qpos).all():
                continue
            if eye is not None:
                eye.look(qpos)
            view = memoryview(np.ascontiguousarray(pictures.draw(qpos))).cast("B")
            while view:  # a pipe takes as much as it has room for
                view = view[os.write(1, view) :]
            time.sleep(max(begin + 1.0 / options["fps"] - time.monotonic(), 0.0))


if __name__ == "__main__":
    try:
        main(json.loads(sys.argv[1]))
    except (InputError, SessionError) as error:
        print(f"camera: {error}", file=sys.stderr)
        sys.exit(2)
    except BrokenPipeError:  # nobody reads any more
        sys.exit(0)
