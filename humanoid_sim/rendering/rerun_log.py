"""Ticks as rerun's viewer takes them: the robot, its links, and plots whose lines have names."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import Any

from humanoid_sim.errors import needing
from humanoid_sim.messages import TickRecord
from humanoid_sim.mit import KEY_PRESSED
from humanoid_sim.recording.links import Links


def rerun_module(purpose: str) -> Any:
    """Return the library, an extra. Raises `MissingPackageError` where it is not installed; `purpose` says what for."""
    with needing("rerun-sdk", "rerun", purpose):
        import rerun  # noqa: PLC0415
        import rerun.urdf  # noqa: PLC0415 - which the first does not load
    return rerun


class RerunLog:
    """Writes one run to one of the library's streams; its poses are `period` s apart."""

    def __init__(
        self,
        library: Any,
        stream: Any,
        joints: tuple[str, ...],
        body: Links,
        action: tuple[str, ...],
        period: float,
    ) -> None:
        """Write what does not change; the policy drives the joints of `action`."""
        self._library, self._stream, self._body, self._action = library, stream, body, action
        self._period, self._due = period, -math.inf
        with tempfile.TemporaryDirectory(prefix="humanoid_sim-") as folder:
            description = Path(folder, "robot.urdf")
            description.write_text(body.urdf, encoding="utf-8")
            library.urdf.UrdfTree.from_file_path(description).log_urdf_to_recording(stream)
        plots = dict.fromkeys(("position", "velocity", "effort", "command"), joints)
        for plot, names in (plots | ({"action": action} if action else {})).items():
            stream.log(f"plots/{plot}", library.SeriesLines(names=list(names)), static=True)

    def tick(self, tick: TickRecord) -> None:
        """Write a tick, if it is time for a pose."""
        time, state, step = float(tick.input.state.time), tick.input.state, tick.output.policy_step
        if not math.isfinite(time) or time < self._due - 1e-9:
            return
        self._due = max(time, self._due + self._period) if math.isfinite(self._due) else time + self._period
        library, stream = self._library, self._stream
        stream.set_time("robot_time", duration=time)
        for (parent, child), (*position, w, x, y, z) in zip(self._body.frames, self._body.poses(tick), strict=True):
            turned = library.Quaternion(xyzw=[x, y, z, w])
            place = library.Transform3D(translation=position, quaternion=turned, parent_frame=parent, child_frame=child)
            stream.log(f"transforms/{child}", place)
        stream.log("plots/position", library.Scalars(state.joint_position))
        stream.log("plots/velocity", library.Scalars(state.joint_velocity))
        stream.log("plots/effort", library.Scalars(state.joint_effort))
        stream.log("plots/command", library.Scalars(tick.output.command.position))
        if step is not None and step.action.shape == (len(self._action),):
            stream.log("plots/action", library.Scalars(step.action))
        keys = state.extern.get(KEY_PRESSED)
        if keys is not None:
            stream.log("keys", library.BarChart(keys.at(time)))
        stream.log("mode", library.TextLog(tick.output.control_mode.mode.name))
