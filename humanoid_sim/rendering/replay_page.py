"""A run as one HTML file that replays it in 3D in any browser, offline; nothing here needs OpenGL."""

from __future__ import annotations

import json
from contextlib import ExitStack, redirect_stdout
from html import escape
from io import StringIO
from pathlib import Path

import mujoco
import viser

from humanoid_sim.errors import InputError
from humanoid_sim.files import output_file, whole_file
from humanoid_sim.rendering.poses import Poses
from humanoid_sim.rendering.robot_scene import RobotScene

_CAPTION = Path(__file__).with_name("replay_caption.html")


def write_page(path: str | Path, model: mujoco.MjModel, poses: Poses, *, title: str) -> None:
    """Write the run. Raises `InputError` if there is no pose, or the file cannot be written."""
    path = output_file(path, "page", ".html")
    if not poses.kept:
        raise InputError(f"page '{path}': nothing to show: no tick came from a simulated robot")
    with ExitStack() as stack:
        stack.enter_context(redirect_stdout(StringIO()))  # viser reports its start and its end
        server = viser.ViserServer("127.0.0.1", 0, verbose=False)
        stack.callback(server.stop)
        scene = RobotScene(server, model)
        server.scene.configure_environment_map(None)  # takes half a minute where a browser draws in software
        serializer = server.get_scene_serializer()
        time, spans = 0.0, list[tuple[float, str]]()
        for pose in poses.kept:
            serializer.insert_sleep(pose.time - time)
            time, ghost = pose.time, None
            if poses.ghost is not None and pose.frame is not None:
                ghost = poses.ghost.pose(model, pose.qpos, pose.frame, pose.alignment)
            scene.show(pose.qpos, ghost)
            if not spans or spans[-1][1] != pose.mode.name:
                spans.append((time, pose.mode.name))
        serializer.insert_sleep(1.0 / poses.rate)
        page = serializer.as_html(dark_mode=True)
    head, body_end, rest = page.replace("<title>Viser<", f"<title>{escape(title)}<", 1).rpartition("</body>")
    caption = _CAPTION.read_text("utf-8").replace("SPANS", json.dumps(spans))
    with whole_file(path) as file:
        file.write((head + caption + body_end + rest).encode())
