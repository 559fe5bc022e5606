"""MuJoCo's window in a process of its own: for a running session, or for a robot whose joints sliders move."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco

from humanoid_sim.cli import parse, run_program
from humanoid_sim.frontends.attach import Attachment, attached
from humanoid_sim.messages import TickRecord
from humanoid_sim.rendering.pictures import check_window, update_pose
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.model import build_model

_REFRESH_PERIOD = 1 / 60  # s


@dataclass(frozen=True)
class ViewerConfig:
    """Watch a running session in MuJoCo's window; or, without a session, move a robot's joints by sliders."""

    session: int | None = None
    """Process id of the session. Default: the only one that runs."""
    robot: str | None = None
    """A robot to show without a session: a shipped one, or the path of a robot's YAML file or of an MJCF."""


def window_text(record: TickRecord, late: str, clock: str) -> tuple[int, int, str, str]:
    """Return the text over a picture, as `set_texts` of MuJoCo's window takes it.

    `late` says that it is not the present; by `clock` a picture that stands still gives itself away.
    """
    size, place = int(mujoco.mjtFontScale.mjFONTSCALE_150), int(mujoco.mjtGridPos.mjGRID_BOTTOMLEFT)
    control = record.output.control_mode
    status = late or ("pose unknown" if record.qpos is None else control.status_message)
    values = f"{clock}\n{float(record.input.state.time):.1f} s\n{control.mode.name}\n{status}"
    return (size, place, "clock\ntime\nmode\nstatus", values)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until the session ends or the window is closed; returns the exit status."""
    config = parse(ViewerConfig, "viewer", arguments)
    check_window()
    if config.robot is None:
        with attached(config.session, "viewer") as attachment:
            _show(attachment.model(), attachment)
    else:
        _show(build_model(load_robot(config.robot)), None)
    return 0


def _show(model: mujoco.MjModel, attachment: Attachment | None) -> None:
    """Show a session; or a robot whose joints the window's sliders move: they write into `qpos`."""
    import mujoco.viewer  # noqa: PLC0415 - loads GLFW

    data: Any = mujoco.MjData(model)
    update_pose(model, data, data.qpos.copy())
    with mujoco.viewer.launch_passive(model, data, show_left_ui=False, show_right_ui=attachment is None) as window:
        print("window open", flush=True)
        while window.is_running() and (attachment is None or attachment.is_running()):
            qpos = data.qpos.copy()
            if attachment is not None:
                attachment.ticks()
                if attachment.latest is not None:
                    record = attachment.latest.record
                    window.set_texts(window_text(record, attachment.lateness(), time.strftime("%H:%M:%S")))
                    qpos = qpos if record.qpos is None else record.qpos
            with window.lock():
                update_pose(model, data, qpos)
            window.sync()
            time.sleep(_REFRESH_PERIOD)


if __name__ == "__main__":
    sys.exit(run_program(main))
