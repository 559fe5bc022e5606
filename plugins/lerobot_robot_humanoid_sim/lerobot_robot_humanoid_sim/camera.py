"""A camera of LeRobot whose pictures another process renders from the session's ticks."""

import json
import logging
import subprocess
import sys
import threading
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from lerobot.cameras import Camera
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError

from lerobot_robot_humanoid_sim.config import HumanoidSimCameraConfig

_START = 180.0
"""s in which the first picture must come: the process imports and compiles what draws."""


class HumanoidSimCamera(Camera):
    """The session's model, seen from outside or from the robot's head."""

    def __init__(self, config: HumanoidSimCameraConfig) -> None:
        """Keep the options."""
        super().__init__(config)
        self.config = config
        self._process: subprocess.Popen[bytes] | None = None
        self._new = threading.Condition()
        self._picture: np.ndarray | None = None
        self._arrived, self._is_seen = -np.inf, True

    def __str__(self) -> str:
        return f"HumanoidSimCamera({self.config.view})"

    @property
    def is_connected(self) -> bool:
        """Return whether pictures may come."""
        return self._process is not None

    @staticmethod
    def find_cameras() -> list[dict[str, Any]]:
        """Return none: a session renders whatever view it is asked for."""
        return []

    def connect(self, warmup: bool = True) -> None:
        """Start the process, and wait for its first picture."""
        if self._process is not None:
            raise DeviceAlreadyConnectedError(f"{self} is already connected")
        # By its path, so that it imports neither LeRobot nor PyTorch; -P keeps this folder off its path.
        command = [sys.executable, "-P", str(Path(__file__).with_name("render.py")), json.dumps(asdict(self.config))]
        self._process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE)
        threading.Thread(target=self._receive, args=(self._process,), name=str(self), daemon=True).start()
        try:
            self.async_read(1e3 * _START)
        except (TimeoutError, DeviceNotConnectedError):
            status = self._process.poll()
            self.disconnect()
            raise ConnectionError(f"{self}: drew no picture (exit status {status})") from None

    def read(self, color_mode: Any = None) -> np.ndarray:
        """Wait for the next picture."""
        return self.async_read(1e3)

    def async_read(self, timeout_ms: float = 200.0) -> np.ndarray:
        """Return the newest picture, shape (height, width, 3), RGB, as soon as there is one that was not read yet."""
        with self._new:
            self._new.wait_for(lambda: not self._is_seen or self._is_gone(), 1e-3 * timeout_ms)
            if self._is_seen:
                self._require()
                raise TimeoutError(f"{self}: no new picture within {timeout_ms:g} ms")
            self._is_seen = True
            return self._picture

    def read_latest(self, max_age_ms: int = 1000) -> np.ndarray:
        """Return the newest picture at once."""
        with self._new:
            self._require()
            age = 1e3 * (time.monotonic() - self._arrived)
            if age > max_age_ms:
                raise TimeoutError(f"{self}: the newest picture is {age:.0f} ms old, at most {max_age_ms}")
            self._is_seen = True
            return self._picture

    def disconnect(self) -> None:
        """End the process."""
        if self._process is None:
            raise DeviceNotConnectedError(f"{self} is not connected")
        process, self._process = self._process, None
        process.terminate()
        process.wait()

    def _is_gone(self) -> bool:
        return self._process is None or self._process.poll() is not None

    def _require(self) -> None:
        if self._is_gone():
            raise DeviceNotConnectedError(f"{self}: nothing draws")

    def _receive(self, process: subprocess.Popen[bytes]) -> None:
        shape = (self.height, self.width, 3)
        with process.stdout as pipe:
            while True:
                data = pipe.read(int(np.prod(shape)))
                with self._new:
                    if len(data) == np.prod(shape):
                        self._picture = np.frombuffer(data, np.uint8).reshape(shape)
                        self._arrived, self._is_seen = time.monotonic(), False
                    self._new.notify_all()
                if len(data) < np.prod(shape):
                    break
        process.wait()
        with self._new:
            self._new.notify_all()
        logging.debug("%s: ended with status %s", self, process.returncode)
