import sys

import mujoco
import numpy as np
import pytest
from pendulum import PENDULUM

from humanoid_sim.errors import InputError
from humanoid_sim.rendering import pictures
from humanoid_sim.rendering.pictures import (
    PoseRenderer,
    check_window,
    choose_opengl,
    has_display,
    require_pictures,
    update_pose,
)

DISPLAY = {"DISPLAY": ":0"}


@pytest.fixture
def machine(monkeypatch):
    def made(environ, libraries=()):
        for name in ("DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL"):
            monkeypatch.delenv(name, raising=False)
        for name, value in environ.items():
            monkeypatch.setenv(name, value)
        monkeypatch.setattr(sys, "platform", "linux")
        monkeypatch.setattr(pictures, "find_library", lambda name: name if name in libraries else None)

    return made


@pytest.mark.parametrize(
    ("environ", "libraries", "expected"),
    [
        ({}, (), ""),
        (DISPLAY, ("OSMesa",), "glfw"),
        ({}, ("EGL", "OSMesa"), "osmesa"),
        ({}, ("EGL",), "egl"),
        (DISPLAY | {"MUJOCO_GL": "osmesa"}, (), "osmesa"),
        (DISPLAY | {"MUJOCO_GL": "disable"}, ("OSMesa",), ""),
    ],
)
def test_the_opengl_that_is_named_or_here_is_chosen(machine, environ, libraries, expected):
    machine(environ, libraries)
    assert choose_opengl() == expected
    assert has_display() is ("DISPLAY" in environ)


def test_what_needs_opengl_is_refused_without_and_the_page_is_named(machine, monkeypatch):
    machine({})
    with pytest.raises(InputError, match=r"^--video: no OpenGL here; --html FILE\.html shows"):
        require_pictures("--video")
    with pytest.raises(InputError, match=r"^pictures: no OpenGL here"):
        PoseRenderer(PENDULUM, 32, 24)
    machine({}, ("OSMesa",))
    monkeypatch.setitem(sys.modules, "mujoco.osmesa", None)
    with pytest.raises(InputError, match=r"pictures: OpenGL \(osmesa\) does not work here: ModuleNotFoundError"):
        PoseRenderer(PENDULUM, 32, 24)
    for display, reason in (("", "no display"), (":4711", "the display does not answer")):
        machine({"DISPLAY": display})
        with pytest.raises(InputError, match=rf"^viewer native: {reason}.*; --html out\.html shows the run"):
            check_window()


def test_a_pose_that_is_not_finite_changes_nothing():
    data = mujoco.MjData(PENDULUM)
    update_pose(PENDULUM, data, np.array([0.5]))
    update_pose(PENDULUM, data, np.array([np.nan]))
    assert data.qpos[0] == 0.5
    assert np.isfinite(data.geom_xpos).all()
