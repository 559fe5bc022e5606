"""rerun's viewer, on a running session: the robot and plots of its joints, in a window or on a page. It only shows."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from mjviser.conversions import merge_geoms

from humanoid_sim.cli import parse, run_program
from humanoid_sim.errors import needing
from humanoid_sim.frontends.attach import Source, shown_qpos
from humanoid_sim.frontends.dds.mirror import Watched
from humanoid_sim.messages import TickRecord
from humanoid_sim.rendering.pictures import has_display
from humanoid_sim.simulation.model import joint_addresses

_HOST, _PORT, _PAGE = "127.0.0.1", 9876, 9090  # rerun's usual ports, for this machine alone
_PERIOD = 0.04  # s between two poses: each costs the library some 20 calls
_STATUS_PERIOD = 0.5  # s
_MEMORY = "1GB"  # that the viewer keeps at most; the oldest is dropped
_SHOWN_GROUPS = 3  # groups of geoms that are drawn; those of the others are for collisions


@dataclass(frozen=True)
class RerunConfig(Watched):
    """Watch a running session in rerun's viewer: the robot, and plots of its joints."""

    web: bool = False
    """A page for browsers on this machine, in place of a window; also where there is no display."""


class RunLog:
    """Writes a session to one of rerun's streams."""

    def __init__(self, stream: Any, source: Source) -> None:
        """Write what does not change: meshes, and the names of the plots' lines."""
        import rerun  # noqa: PLC0415 - an extra

        self._rerun, self._stream, self._model = rerun, stream, source.model()
        self._data = mujoco.MjData(self._model)
        self._joints = joint_addresses(self._model, source.header.joint_names).qpos
        model = self._model
        is_shown = (model.geom_group < _SHOWN_GROUPS) & (model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE)
        self._bodies = {body: f"robot/{model.body(body).name}" for body in set(model.geom_bodyid[is_shown].tolist())}
        for body, path in self._bodies.items():
            geoms = np.flatnonzero(is_shown & (model.geom_bodyid == body)).tolist()
            mesh, color = merge_geoms(model, geoms), np.append(model.geom_rgba[geoms[0], :3], 1.0)
            vertices, faces, normals = mesh.vertices, mesh.faces, mesh.vertex_normals
            shape = rerun.Mesh3D(
                vertex_positions=vertices, triangle_indices=faces, vertex_normals=normals, albedo_factor=color
            )
            stream.log(path, shape, static=True)
        for plot in ("position", "command", "velocity", "effort"):
            stream.log(f"plots/{plot}", rerun.SeriesLines(names=list(source.header.joint_names)), static=True)

    def tick(self, record: TickRecord) -> None:
        rerun, stream, data, state = self._rerun, self._stream, self._data, record.input.state
        stream.set_time("robot_time", duration=float(state.time))
        data.qpos[:] = shown_qpos(record, data.qpos, self._joints)
        mujoco.mj_kinematics(self._model, data)
        for body, path in self._bodies.items():
            turn = rerun.Quaternion(xyzw=np.roll(data.xquat[body], -1))
            stream.log(path, rerun.Transform3D(translation=data.xpos[body], quaternion=turn))
        stream.log("plots/position", rerun.Scalars(state.joint_position))
        stream.log("plots/command", rerun.Scalars(record.output.command.position))
        stream.log("plots/velocity", rerun.Scalars(state.joint_velocity))
        stream.log("plots/effort", rerun.Scalars(state.joint_effort))

    def status(self, source: Source) -> None:
        """Write the mode, and the time of day, by which a picture that stands still gives itself away."""
        text = time.strftime("%H:%M:%S")
        if source.latest is not None:
            control = source.latest.record.output.control_mode
            text = f"# {source.lateness() or control.mode.name}\n\n{control.status_message}\n\n{text}"
        document = self._rerun.TextDocument(text, media_type=self._rerun.MediaType.MARKDOWN)
        self._stream.log("status", document, static=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until the session ends or the viewer is closed; returns the exit status."""
    config = parse(RerunConfig, "rerun", arguments)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    os.environ["RUST_LOG"] = "off"  # its messages about a viewer that was closed
    with needing("rerun-sdk", "rerun", "rerun's viewer"):
        import rerun  # noqa: PLC0415 - an extra
    with config.source("rerun") as source, _viewer(is_page=config.web or not has_display()) as viewer:
        stream = rerun.RecordingStream("humanoid_sim")
        stream.connect_grpc(f"rerun+http://{_HOST}:{_PORT}/proxy")
        log, reported = RunLog(stream, source), 0.0
        while viewer.poll() is None and source.is_running():
            for tick in source.ticks(_PERIOD)[-1:]:
                log.tick(tick.record)
            if time.monotonic() - reported > _STATUS_PERIOD:
                log.status(source)
                reported = time.monotonic()
            time.sleep(_PERIOD)
    return 0


@contextmanager
def _viewer(*, is_page: bool) -> Iterator[subprocess.Popen[bytes]]:
    """Start the viewer, and end it."""
    import rerun_cli  # noqa: PLC0415 - an extra

    program = str(Path(rerun_cli.__file__).with_name("rerun"))
    command = [program, "--bind", _HOST, "--port", str(_PORT), "--memory-limit", _MEMORY, "--expect-data-soon"]
    serves = "rerun's window"
    if is_page:
        command += ["--serve-web", "--web-viewer-port", str(_PAGE), "--server-memory-limit", _MEMORY]
        serves = f"rerun's page: http://{_HOST}:{_PAGE}/?url=rerun%2Bhttp://{_HOST}:{_PORT}/proxy"
    with subprocess.Popen(command, stdin=subprocess.DEVNULL, env={**os.environ, "RUST_LOG": "error"}) as viewer:
        try:
            print(serves, flush=True)
            yield viewer
        finally:
            viewer.terminate()


if __name__ == "__main__":
    sys.exit(run_program(main))
