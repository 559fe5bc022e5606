import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.rendering.backend import choose_backend, has_display

DISPLAY = {"DISPLAY": ":0"}


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
def test_the_first_that_is_asked_for_or_there_is_taken(environ, libraries, egl_works, expected):
    choice = choose_backend(
        environ,
        platform="linux",
        find_library=lambda name: f"lib{name}.so" if name in libraries else None,
        try_egl=lambda: egl_works,
    )
    assert choice.opengl == expected
    assert choice.reason
    assert "\n" not in str(choice)


@pytest.mark.parametrize(
    ("environ", "libraries", "said"),
    [
        ({}, (), "software painter (no display, no libOSMesa, no libEGL)"),
        ({}, ("OSMesa",), "osmesa (no display; libOSMesa is installed)"),
        ({}, ("EGL",), "software painter (no display, no libOSMesa; libEGL is installed but makes no context)"),
        ({"MUJOCO_GL": "off"}, ("OSMesa",), "software painter (MUJOCO_GL=off)"),
    ],
)
def test_it_says_what_and_why(environ, libraries, said):
    choice = choose_backend(
        environ, platform="linux", find_library=lambda name: name if name in libraries else None, try_egl=lambda: False
    )
    assert str(choice) == said


def test_a_value_that_mujoco_does_not_know_is_refused():
    with pytest.raises(InputError, match=r"MUJOCO_GL: is 'vulkan', accepted: glfw, osmesa, egl, disable"):
        choose_backend({"MUJOCO_GL": "vulkan"}, platform="linux")


def test_a_desktop_without_x_has_a_display():
    assert has_display({}, platform="darwin")
    assert has_display({}, platform="win32")
    assert not has_display({}, platform="linux")
