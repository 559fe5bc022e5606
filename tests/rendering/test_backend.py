import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.rendering import backend
from humanoid_sim.rendering.backend import choose_opengl, has_display, require_pictures

DISPLAY = {"DISPLAY": ":0"}


@pytest.fixture
def machine(monkeypatch):
    def made(environ, libraries=(), egl_works=False, platform="linux"):
        for name in ("DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL"):
            monkeypatch.delenv(name, raising=False)
        for name, value in environ.items():
            monkeypatch.setenv(name, value)
        monkeypatch.setattr(backend.sys, "platform", platform)
        monkeypatch.setattr(backend, "find_library", lambda name: f"lib{name}.so" if name in libraries else None)
        monkeypatch.setattr(backend, "egl_works", lambda: egl_works)

    return made


@pytest.mark.parametrize(
    ("environ", "libraries", "egl_works", "expected"),
    [
        ({}, (), False, "none"),
        ({}, ("OSMesa",), False, "osmesa"),
        ({}, ("OSMesa", "EGL"), True, "osmesa"),
        ({}, ("EGL",), True, "egl"),
        ({}, ("EGL",), False, "none"),
        (DISPLAY, ("OSMesa", "EGL"), True, "glfw"),
        ({"WAYLAND_DISPLAY": "wayland-0"}, (), False, "glfw"),
        ({"DISPLAY": ""}, ("OSMesa",), False, "osmesa"),
        (DISPLAY | {"MUJOCO_GL": "osmesa"}, (), False, "osmesa"),
        (DISPLAY | {"MUJOCO_GL": " EGL "}, (), False, "egl"),
        (DISPLAY | {"MUJOCO_GL": "disable"}, ("OSMesa",), False, "none"),
        ({"MUJOCO_GL": "glx"}, ("OSMesa",), False, "glfw"),
        ({"MUJOCO_GL": "on"}, ("OSMesa",), False, "osmesa"),
        ({"MUJOCO_GL": ""}, (), False, "none"),
    ],
)
def test_the_first_that_is_asked_for_or_there_is_taken(machine, environ, libraries, egl_works, expected):
    machine(environ, libraries, egl_works)
    assert choose_opengl() == expected


def test_a_value_that_mujoco_does_not_know_is_refused(machine):
    machine({"MUJOCO_GL": "vulkan"})
    with pytest.raises(InputError, match=r"MUJOCO_GL: is 'vulkan', accepted: glfw, osmesa, egl, disable"):
        choose_opengl()


@pytest.mark.parametrize(("platform", "expected"), [("darwin", True), ("win32", True), ("linux", False)])
def test_a_desktop_without_x_has_a_display(machine, platform, expected):
    machine({}, platform=platform)
    assert has_display() is expected


def test_a_picture_without_opengl_is_refused_and_the_page_is_named(machine):
    machine({})
    with pytest.raises(InputError, match=r"^--video: no OpenGL here; --html FILE\.html shows"):
        require_pictures("--video")
    machine({}, ("OSMesa",))
    require_pictures("--video")
