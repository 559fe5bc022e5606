"""A run as one HTML file that replays it in 3D in any browser, offline; nothing here needs OpenGL or a network."""

from __future__ import annotations

import asyncio
import contextlib
import io
import json
import math
from collections.abc import Iterator
from html import escape
from pathlib import Path
from typing import Any
from unittest.mock import patch

import mjviser
import mujoco
import numpy as np
import viser
from viser.infra._async_message_buffer import AsyncMessageBuffer

from humanoid_sim.errors import InputError
from humanoid_sim.files import output_file, whole_file
from humanoid_sim.mit import FloatArray
from humanoid_sim.rendering.camera import floating_base, make_camera, tint_sides
from humanoid_sim.rendering.caption import MODE_COLOURS
from humanoid_sim.rendering.figure import Figure
from humanoid_sim.rendering.moments import Moments

_GHOST = (64, 200, 120)
_SMOOTHING = 1.0  # s before and after a moment, over which the floor's motion under a robot that walks is averaged
_LIGHTS = ((-50.0, 2.5), (50.0, 1.5), (180.0, 1.5))  # degrees from the camera, and intensity
_CAPTION = Path(__file__).with_name("replay_caption.html")


def write_page(path: str | Path, model: mujoco.MjModel, moments: Moments, *, title: str) -> None:
    """Write the run; `model`'s colours may be changed.

    Raises `InputError` if there is no pose, or the file cannot be written.
    """
    path = output_file(path, "page", ".html")
    if not moments.kept:
        raise InputError(f"page '{path}': nothing to show: no tick came from a simulated robot")
    tint_sides(model)
    data = mujoco.MjData(model)
    offsets = _offsets(model, data, moments)
    with _scene() as server:
        _aim_and_light(server, model)
        scene = mjviser.ViserMujocoScene(server, model, num_envs=1)
        scene.camera_tracking_enabled = False
        ghost = None if moments.ghost is None else Figure(server, model, "reference", _GHOST)
        serializer = server.get_scene_serializer()
        time = 0.0
        for moment, pose, offset in zip(moments.kept, moments.ghosts(model), offsets, strict=True):
            serializer.insert_sleep(moment.time - time)
            time = moment.time
            data.qpos[:] = moment.qpos
            mujoco.mj_kinematics(model, data)
            scene.update_from_arrays((data.xpos + offset)[None], data.xmat.reshape(1, -1, 3, 3))
            scene.fixed_bodies_frame.position = offset
            if ghost is not None:
                ghost.hide() if pose is None else ghost.show(pose, offset)
        serializer.insert_sleep(1.0 / moments.rate)
        page = serializer.as_html(dark_mode=True)
    head, body_end, rest = page.replace("<title>Viser<", f"<title>{escape(title)}<", 1).rpartition("</body>")
    with whole_file(path) as file:
        file.write((head + _caption(moments, title) + body_end + rest).encode())


@contextlib.contextmanager
def _scene() -> Iterator[viser.ViserServer]:
    """Yield viser's scene and all that collects its messages, without socket and thread."""

    def start(server: Any) -> None:
        server._broadcast_buffer = AsyncMessageBuffer(asyncio.new_event_loop(), persistent_messages=True)

    def stop(server: Any) -> None:
        server._broadcast_buffer.event_loop.close()

    with patch.multiple(viser.infra.WebsockServer, start=start, stop=stop):
        with contextlib.redirect_stdout(io.StringIO()):
            server = viser.ViserServer(verbose=False)
        try:
            yield server
        finally:
            server.stop()


def _offsets(model: mujoco.MjModel, data: mujoco.MjData, moments: Moments) -> FloatArray:
    """Return the shift of the world at each pose, shape (t, 3), m, by which a robot that walks stays in place."""
    offsets = np.zeros((len(moments.kept), 3))
    base = floating_base(model)
    if base is None:
        return offsets
    for offset, moment in zip(offsets, moments.kept, strict=True):
        data.qpos[:] = moment.qpos
        mujoco.mj_kinematics(model, data)
        offset[:2] = -data.xpos[base, :2]
    half = round(_SMOOTHING * moments.rate)
    padded = np.pad(offsets, ((half, half), (0, 0)), mode="edge")
    window = np.full(2 * half + 1, 1.0 / (2 * half + 1))
    return np.stack([np.convolve(column, window, mode="valid") for column in padded.T], axis=-1)


def _aim_and_light(server: viser.ViserServer, model: mujoco.MjModel) -> None:
    """Look at the robot as every picture of it does, with lights from four sides.

    Without the image of surroundings, which takes half a minute where a browser draws in software.
    """
    view = make_camera(model)

    def around(degrees: float, elevation: float) -> FloatArray:
        azimuth = math.radians(view.azimuth + 180.0 + degrees)
        level = math.cos(elevation)
        return np.array([level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation)])

    camera = server.initial_camera
    camera.look_at = tuple(view.lookat)
    camera.position = tuple(view.lookat + view.distance * around(0.0, -math.radians(view.elevation)))
    camera.fov = math.radians(model.vis.global_.fovy)
    server.scene.configure_environment_map(None)
    server.scene.configure_default_lights(cast_shadow=False)
    far = 2.0 * view.distance
    for i, (degrees, intensity) in enumerate(_LIGHTS):
        place = view.lookat + far * around(degrees, math.radians(27.0))
        server.scene.add_light_point(f"/lights/{i}", intensity=intensity * far**2, position=place)


def _caption(moments: Moments, title: str) -> str:
    """Return the strip that says which mode it is, and its script, which reads the time off the page's slider."""
    spans: list[tuple[float, str, bool, str, float]] = []
    for moment in moments.kept:
        mode = moment.caption.mode
        fallen = moments.fell is not None and moment.caption.time >= moments.fell
        if not spans or spans[-1][1:3] != (mode.name, fallen):
            begin = spans[-1][4] if spans and spans[-1][1] == mode.name else moment.time
            spans.append((moment.time, mode.name, fallen, "rgb({},{},{})".format(*MODE_COLOURS[mode]), begin))
    data = json.dumps({"title": title, "spans": spans}).replace("<", "\\u003c")
    return _CAPTION.read_text("utf-8").replace("DATA", data)
