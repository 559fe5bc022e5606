"""MuJoCo's window in a process of its own: for a running session, or for a robot whose joints sliders move."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco

from humanoid_sim.cli import parse, run_program
from humanoid_sim.errors import InputError
from humanoid_sim.frontends.attach import Attachment, attached, ready
from humanoid_sim.messages import TickRecord
from humanoid_sim.rendering.camera import update_pose
from humanoid_sim.rendering.caption import Caption
from humanoid_sim.rendering.native_viewer import check_window, open_window
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


def window_texts(record: TickRecord | None, late: str, clock: str) -> list[tuple[int, int, str, str]]:
    """Return the texts over a picture, as `set_texts` of MuJoCo's window takes them.

    Args:
        late: that it is not the present; empty if it is.
        clock: the time of day, by which a picture that stands still gives itself away.
    """
    small, big = int(mujoco.mjtFontScale.mjFONTSCALE_150), int(mujoco.mjtFontScale.mjFONTSCALE_300)
    bottom, top = int(mujoco.mjtGridPos.mjGRID_BOTTOMLEFT), int(mujoco.mjtGridPos.mjGRID_TOP)
    if record is None:
        return [(small, bottom, "clock", clock), (big, top, "no tick yet", "")]
    caption = Caption.of(record)
    values = f"{clock}\n{caption.time:.1f} s\n{caption.mode.name}\n{caption.message}"
    texts = [(small, bottom, "clock\ntime\nmode\nstatus", values)]
    if record.qpos is None:
        texts.append((big, top, "pose unknown", ""))
    elif late:
        texts.append((big, top, late, ""))
    return texts


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until the session ends or the window is closed; returns the exit status."""
    config = parse(ViewerConfig, "viewer", arguments)
    if config.robot is None:
        with attached(config.session, "viewer", niceness=10) as attachment:
            model = attachment.model()
            check_window()
            _watch(attachment, model)
        return 0
    if config.session is not None:
        raise InputError("--robot and --session: a window shows one of them, expected one option")
    description = load_robot(config.robot)
    model = build_model(description)
    check_window()
    _move(model, description.name)
    return 0


def _watch(attachment: Attachment, model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    update_pose(model, data, data.qpos.copy())
    with open_window(model, data) as window:
        ready(f"window of {attachment}")
        while window.is_running() and attachment.is_running():
            if attachment.ticks():
                record = attachment.latest_record
                if record is not None and record.qpos is not None:
                    with window.lock():
                        update_pose(model, data, record.qpos)
            window.set_texts(window_texts(attachment.latest_record, attachment.lateness(), time.strftime("%H:%M:%S")))
            window.sync()
            time.sleep(_REFRESH_PERIOD)


def _move(model: mujoco.MjModel, name: str) -> None:
    """Move the robot: the window's sliders write into `qpos` when it is synchronised."""
    data: Any = mujoco.MjData(model)
    update_pose(model, data, data.qpos.copy())
    with open_window(model, data, sliders=True) as window:
        ready(f"window of {name}: its joints are in the panel on the right, under Joint")
        while window.is_running():
            window.sync()
            with window.lock():
                update_pose(model, data, data.qpos.copy())
            time.sleep(_REFRESH_PERIOD)


if __name__ == "__main__":
    sys.exit(run_program(main))
