"""A camera of LeRobot that draws the session's newest ticks, with OpenGL, in a thread."""

import threading
from contextlib import closing
from typing import Any

import mujoco
import numpy as np
from lerobot.cameras import Camera
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError

from humanoid_sim.client import Feed, find_session
from humanoid_sim.errors import InputError
from humanoid_sim.rendering.camera import update_pose
from humanoid_sim.rendering.offscreen import PoseRenderer
from humanoid_sim.session.feed import MODEL_BLOB
from humanoid_sim.simulation.model import joint_addresses
from lerobot_robot_humanoid_sim.config import HumanoidSimCameraConfig

_FIRST = 180.0  # s in which the first picture must come: OpenGL may compile what draws
_CARRIERS = ("head", "torso", "chest")  # parts of names of the body that carries the camera of `ego`
_PITCH, _FIELD = 45.0, 70.0  # degrees by which it looks down, and of height that it sees
_LOOKAT = 0.5  # m from the eye to what is looked at


class HumanoidSimCamera(Camera):
    """The session's model, seen from outside or from the robot's head."""

    def __init__(self, config: HumanoidSimCameraConfig) -> None:
        super().__init__(config)
        self.config = config
        self._thread: threading.Thread | None = None
        self._stopped, self._new = threading.Event(), threading.Event()
        self._picture: np.ndarray | None = None
        self._failure = "nothing draws"

    def __str__(self) -> str:
        return f"HumanoidSimCamera({self.config.view})"

    @property
    def is_connected(self) -> bool:
        """Return True between `connect` and `disconnect`."""
        return self._thread is not None

    @staticmethod
    def find_cameras() -> list[dict[str, Any]]:
        """Return none: any view can be drawn."""
        return []

    def connect(self, warmup: bool = True) -> None:
        """Attach to the session, and wait for a first picture."""
        if self._thread is not None:
            raise DeviceAlreadyConnectedError(f"{self} is already connected")
        self._stopped.clear()
        self._new.clear()
        self._thread = threading.Thread(target=self._run, name=str(self), daemon=True)
        self._thread.start()
        try:
            self.async_read(1e3 * _FIRST)
        except (TimeoutError, DeviceNotConnectedError) as error:
            self.disconnect()
            raise ConnectionError(f"{self}: drew no picture: {error}") from None

    def read(self, color_mode: Any = None) -> np.ndarray:
        """Wait for the next picture."""
        return self.async_read(1e3)

    def async_read(self, timeout_ms: float = 200.0) -> np.ndarray:
        """Return the newest picture, shape (height, width, 3), RGB, as soon as there is one that was not read yet."""
        if not self._new.wait(1e-3 * timeout_ms):
            raise TimeoutError(f"{self}: no new picture within {timeout_ms:g} ms")
        self._new.clear()
        return self.read_latest()

    def read_latest(self, max_age_ms: int = 1000) -> np.ndarray:
        """Return the newest picture at once."""
        if self._thread is None or not self._thread.is_alive():
            raise DeviceNotConnectedError(f"{self}: {self._failure}")
        return self._picture

    def disconnect(self) -> None:
        """Stop drawing."""
        if self._thread is None:
            raise DeviceNotConnectedError(f"{self} is not connected")
        self._stopped.set()
        self._thread.join()
        self._thread = None

    def _run(self) -> None:
        try:
            with closing(Feed(find_session(self.config.session))) as feed:
                self._draw(feed)
        except Exception as error:  # OpenGL, the session or the view; LeRobot's next read says it
            self._failure = str(error)
        self._new.set()

    def _draw(self, feed: Feed) -> None:
        """Draw the newest ticks until the session ends."""
        view = self.config.view
        model = mujoco.MjModel.from_binary_path(MODEL_BLOB, {MODEL_BLOB: feed.blob(MODEL_BLOB)})
        qpos, addresses = model.qpos0.copy(), joint_addresses(model, feed.joint_names).qpos
        eye = Eye(model) if view == "ego" else None
        camera = eye.camera if eye is not None else None if view == "outside" else view
        with closing(PoseRenderer(lambda: model, self.width, self.height, camera)) as pictures:
            while not self._stopped.wait(1.0 / self.fps) and feed.is_running():
                sample = feed.latest() or feed.wait(0, 0.5)
                if sample is None:
                    continue
                tick = feed.decode(sample)
                if tick["has_qpos"]:
                    qpos[:] = tick["qpos"]
                else:  # motors; a joint that was not received stays as it was
                    known = np.isfinite(tick["joint_position"])
                    qpos[addresses[known]] = tick["joint_position"][known]
                if eye is not None:
                    eye.look(qpos)
                self._picture = pictures.draw(qpos)
                self._new.set()
        self._failure = "the session has ended"


class Eye:
    """A camera in front of the head, which turns with it but stays upright; a robot's initial pose looks along +x."""

    def __init__(self, model: mujoco.MjModel) -> None:
        names = [model.body(index).name for index in range(1, model.nbody)]
        found = [name for word in _CARRIERS for name in names if word in name]
        if not found:
            raise InputError(f"camera: no body is called {' or '.join(_CARRIERS)}; it has: {', '.join(names)}")
        self._model, self._data, self._body = model, mujoco.MjData(model), model.body(found[0]).id
        update_pose(model, self._data, model.qpos0)
        geoms = np.flatnonzero(model.geom_bodyid == self._body)
        places = self._data.geom_xpos[geoms] - self._data.xpos[self._body]
        front = (places[:, 0] + model.geom_rbound[geoms]).max(initial=0.0)
        height = places[:, 2].mean() if len(geoms) else 0.0
        turn, pitch = self._data.xmat[self._body].reshape(3, 3), np.radians(_PITCH)
        self._place = turn.T @ (front, 0.0, height)
        self._gaze = turn.T @ (np.cos(pitch), 0.0, -np.sin(pitch))
        model.vis.global_.fovy = _FIELD
        self.camera = mujoco.MjvCamera()
        self.camera.distance = _LOOKAT

    def look(self, qpos: np.ndarray) -> None:
        """Bring the camera to where the body is."""
        update_pose(self._model, self._data, qpos)
        turn = self._data.xmat[self._body].reshape(3, 3)
        gaze = turn @ self._gaze
        self.camera.lookat[:] = self._data.xpos[self._body] + turn @ self._place + _LOOKAT * gaze
        self.camera.azimuth = np.degrees(np.arctan2(gaze[1], gaze[0]))
        self.camera.elevation = np.degrees(np.arcsin(np.clip(gaze[2], -1.0, 1.0)))
