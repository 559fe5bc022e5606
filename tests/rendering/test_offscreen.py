import sys

import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.rendering import offscreen
from humanoid_sim.rendering.offscreen import PoseRenderer


def test_opengl_that_does_not_work_is_said_every_time(pendulum, monkeypatch):
    monkeypatch.setattr(offscreen, "_failures", {})
    monkeypatch.setattr(offscreen, "choose_opengl", lambda: "osmesa")
    monkeypatch.setitem(sys.modules, "mujoco.osmesa", None)
    for _ in range(2):
        with pytest.raises(InputError, match=r"pictures: OpenGL \(osmesa\) does not work here: ModuleNotFoundError"):
            PoseRenderer(lambda: pendulum, 32, 24).draw(pendulum.qpos0)


def test_a_machine_without_opengl_draws_nothing_and_says_so(pendulum, monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "off")
    with pytest.raises(InputError, match=r"^pictures: no OpenGL here; Debian's package libosmesa6"):
        PoseRenderer(lambda: pendulum, 32, 24).draw(pendulum.qpos0)
