"""MuJoCo's own window: as `open_window` for a program of its own, as a sink for whoever simulates without motors."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import mujoco

from humanoid_sim.errors import InputError
from humanoid_sim.messages import SessionHeader, TickRecord
from humanoid_sim.rendering.backend import has_display
from humanoid_sim.rendering.caption import Caption
from humanoid_sim.rendering.offscreen import make_camera, update_pose
from humanoid_sim.session.sinks import Sink

_INSTEAD = "--html out.html shows the run in a browser"
_REFRESH_PERIOD = 1 / 60
_OPENING_TIMEOUT = 30.0
_CLOSING_TIMEOUT = 5.0


class NativeViewerSink(Sink):
    """Shows the latest pose in a window, at most 60 times a second, from a thread with a model and data of its own.

    When a user closes the window the run goes on; `closed` says so. Raises `InputError`, which says what to use
    instead, if no window can be opened here.
    The model factory is called once, by `start`.
    """

    def __init__(self, model_factory: Callable[[], mujoco.MjModel]) -> None:
        check_window()
        self._model_factory = model_factory
        self._latest: TickRecord | None = None
        self._stop, self._opened, self._closed = threading.Event(), threading.Event(), threading.Event()
        self._failure = ""
        self._thread = threading.Thread(target=self._run, name="native viewer", daemon=True)

    @property
    def closed(self) -> bool:
        """Return whether the window has been closed, by the user or by `close`."""
        return self._closed.is_set()

    def start(self, header: SessionHeader) -> None:
        """Open the window and wait until it is there. Raises `InputError` if it cannot be opened."""
        self._thread.start()
        if not self._opened.wait(_OPENING_TIMEOUT):
            self._failure = self._failure or f"not there after {_OPENING_TIMEOUT:g} s"
        if self._failure:
            raise InputError(f"viewer native: the window cannot be opened ({self._failure}); {_INSTEAD}")

    def tick(self, record: TickRecord) -> None:
        """Put the pose where the window's thread finds it."""
        if record.qpos is not None:
            self._latest = record

    def close(self) -> None:
        """Close the window and wait for its threads. May be called twice."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(2 * _CLOSING_TIMEOUT)

    def _run(self) -> None:
        others = set(threading.enumerate())
        try:
            self._show()
        except Exception as error:  # whatever a window raises, it must not reach the control loop
            self._failure = f"{type(error).__name__}: {error}"
        finally:
            self._closed.set()
            self._opened.set()
        # MuJoCo's window has threads without handles; GLFW must not be torn down at exit while they draw.
        for thread in set(threading.enumerate()) - others:
            if "_launch_internal" in thread.name or "_reload" in thread.name:
                thread.join(_CLOSING_TIMEOUT)

    def _show(self) -> None:
        model = self._model_factory()
        data = mujoco.MjData(model)
        update_pose(model, data, data.qpos.copy())
        with open_window(model, data) as window:
            self._opened.set()
            shown = None
            while not self._stop.wait(_REFRESH_PERIOD) and window.is_running():
                record = self._latest
                if record is None or record is shown or record.qpos is None:
                    continue
                shown = record
                with window.lock():
                    update_pose(model, data, record.qpos)
                caption = Caption.of(record)
                values = f"{caption.time:.1f} s\n{caption.mode.name}\n{caption.message}"
                window.set_texts((None, None, "time\nmode\nstatus", values))
                window.sync()


@contextmanager
def open_window(model: mujoco.MjModel, data: mujoco.MjData, *, sliders: bool = False) -> Iterator[Any]:
    """MuJoCo's window (`mujoco.viewer.launch_passive`), seen by the camera that videos have.

    `data` has its pose computed. With `sliders` the panel is open that has one for each joint.
    """
    import mujoco.viewer  # noqa: PLC0415 - loads GLFW, which only a machine with a display has

    camera = make_camera(model)
    with mujoco.viewer.launch_passive(model, data, show_left_ui=False, show_right_ui=sliders) as window:
        with window.lock():
            window.cam.type, window.cam.trackbodyid = camera.type, camera.trackbodyid
            window.cam.lookat[:] = camera.lookat
            window.cam.distance, window.cam.azimuth = camera.distance, camera.azimuth
            window.cam.elevation = camera.elevation
        yield window


def check_window() -> None:
    """Open an invisible window: a display may be named and not answer, or answer and have no OpenGL."""
    if not has_display():
        raise InputError(f"viewer native: no display (neither DISPLAY nor WAYLAND_DISPLAY is set); {_INSTEAD}")
    reason = ""
    with warnings.catch_warnings(record=True) as complaints:
        warnings.simplefilter("always")
        try:
            import glfw  # noqa: PLC0415 - warns, or fails, where its library is missing

            if glfw.init():
                glfw.window_hint(glfw.VISIBLE, 0)
                window = glfw.create_window(64, 64, "probe", None, None)
                glfw.default_window_hints()
                if window:
                    glfw.destroy_window(window)
                    return
        except (ImportError, OSError) as error:
            reason = str(error)
    reason = reason or "; ".join(str(complaint.message) for complaint in complaints) or "GLFW gives no reason"
    raise InputError(f"viewer native: the display opens no window ({reason}); {_INSTEAD}")
