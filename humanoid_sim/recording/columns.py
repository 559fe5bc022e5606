"""A recording as columns: arrays with a row per tick, a table for CSV files and pandas, and a figure."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from humanoid_sim.errors import needing, require_known
from humanoid_sim.messages import Mode, TickRecord
from humanoid_sim.mit import COMMAND_FIELDS, FloatArray

if TYPE_CHECKING:
    from humanoid_sim.recording.reader import Recording

_MEASURED = ("position", "velocity", "effort")
_IMU = ("imu_quaternion", "imu_angular_velocity", "imu_linear_acceleration")
_SHOWN = 7
"""Joints of a figure, where none are named."""
_COLOURS = {Mode.DAMPING: "gold", Mode.STANDBY: "skyblue", Mode.LOCOMOTION: "lightgreen", Mode.REMOTE: "plum"}


def action_names(recording: Recording) -> tuple[str, ...]:
    """Return the joints that the recorded policy drives; none without a policy."""
    from humanoid_sim.stack import recorded_contract  # noqa: PLC0415 - heavier than all the rest here

    contract = recorded_contract(recording.header)
    return () if contract is None else contract.action_joint_names


def column_names(recording: Recording) -> list[str]:
    """Return the names of the table's columns, such as `position/left_elbow_pitch`."""
    joints = recording.header.joint_names
    quantities = (*_MEASURED, *(f"command_{name}" for name in COMMAND_FIELDS))
    return [
        *("time_s", "mode", "controller"),
        *(f"{quantity}/{joint}" for quantity in quantities for joint in joints),
        *(f"{name}/{part}" for name in _IMU for part in ("wxyz" if name == _IMU[0] else "xyz")),
        *("policy_frame", *(f"action/{name}" for name in action_names(recording))),
    ]


def rows(recording: Recording) -> Iterator[list[object]]:
    """Yield a row per tick; what a tick does not have is empty text. Raises `InputError` as `Recording.ticks` does."""
    actions = len(action_names(recording))
    for tick in recording.ticks():
        control, step = tick.output.control_mode, tick.output.policy_step
        values = [value for array in _arrays_of(tick) for value in array.tolist()]
        answer = [] if step is None else step.action.reshape(-1).tolist()[:actions]
        frame = "" if step is None else step.frame
        blanks = [""] * (actions - len(answer))
        yield [
            float(tick.input.state.time),
            control.mode.name,
            control.controller_name,
            *values,
            frame,
            *answer,
            *blanks,
        ]


def arrays(recording: Recording) -> dict[str, Any]:
    """Return everything as arrays, a row per tick.

    `time`, shape (t,), s on the robot's clock; `mode`, (t,), numbers of `Mode`; `position`, `velocity`, `effort` and
    `command_position`, `command_velocity`, `command_effort`, `command_stiffness`, `command_damping`, (t, n), in the
    recording's order of joints, rad, rad/s, N·m, N·m/rad and N·m·s/rad; `imu_quaternion`, (t, 4), w x y z,
    `imu_angular_velocity` and `imu_linear_acceleration`, (t, 3), rad/s and m/s² in the IMU's frame; `action`, (t, m),
    NaN where no policy ran. Raises `InputError` as `Recording.ticks` does.
    """
    joints = len(recording.header.joint_names)
    widths = dict.fromkeys((*_MEASURED, *(f"command_{name}" for name in COMMAND_FIELDS)), joints)
    widths |= dict(zip(_IMU, (4, 3, 3), strict=True))
    none = np.full(len(action_names(recording)), np.nan)
    times, modes, actions, found = [], [], [], []
    for tick in recording.ticks():
        step = tick.output.policy_step
        times.append(float(tick.input.state.time))
        modes.append(int(tick.output.control_mode.mode))
        actions.append(none if step is None else step.action.reshape(-1)[: len(none)])
        found.append(_arrays_of(tick))
    columns = (np.array([arrays[i] for arrays in found]) for i in range(len(widths)))
    stacked = {name: column.reshape(-1, widths[name]) for name, column in zip(widths, columns, strict=True)}
    numbers = {"time": np.array(times), "mode": np.array(modes, dtype=np.int64)}
    return {**numbers, **stacked, "action": np.array(actions).reshape(-1, max(len(none), 1))[:, : len(none)]}


def frame(recording: Recording) -> Any:
    """Return the table as a pandas frame. Raises `MissingPackageError` without pandas."""
    with needing("pandas", "report", "a frame"):
        import pandas as pd  # noqa: PLC0415 - an optional package
    return pd.DataFrame(rows(recording), columns=column_names(recording)).replace("", np.nan)


def figure(recording: Recording, joints: Sequence[str] = ()) -> Any:
    """Draw the joints' positions and commands over time, the modes as background; the first few where none are named.

    Where a command has no stiffness, its position means nothing and is left out. Raises `InputError` if a joint is not
    one of the recording's, and `MissingPackageError` if Matplotlib is not installed, of which the figure is.
    """
    with needing("matplotlib", "report", "a figure"):
        from matplotlib.figure import Figure  # noqa: PLC0415 - an optional package
    names = recording.header.joint_names
    require_known("joint", joints, names, "joints: ")
    shown, columns = joints or names[:_SHOWN], arrays(recording)
    commands = np.where(columns["command_stiffness"] > 0.0, columns["command_position"], np.nan)

    class Shown(Figure):
        """Is drawn in a notebook, whatever else it has imported."""

        def _repr_png_(self) -> bytes:
            picture = io.BytesIO()
            self.savefig(picture, format="png")
            return picture.getvalue()

    drawn = Shown(figsize=(9.0, 1.3 * len(shown) + 0.9), layout="constrained")
    axes = drawn.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
    for axis, joint in zip(axes, shown, strict=True):
        column = names.index(joint)
        _colour_modes(axis, columns["time"], columns["mode"])
        axis.plot(columns["time"], commands[:, column], color="tab:orange", label="command")
        axis.plot(columns["time"], columns["position"][:, column], color="tab:blue", label="position")
        axis.set_ylabel(f"{joint}\nrad", rotation=0, ha="right", va="center", fontsize="small")
    labelled = dict(zip(*reversed(axes[0].get_legend_handles_labels()), strict=True))
    drawn.legend(labelled.values(), labelled, loc="outside upper center", ncols=len(labelled), fontsize="small")
    axes[-1].set_xlabel("s")
    return drawn


def _colour_modes(axis: Any, time: FloatArray, mode: FloatArray) -> None:
    ends = [*np.flatnonzero(np.diff(mode)), len(mode) - 1] if len(mode) else []
    begin = 0
    for end in ends:
        shown = Mode(int(mode[end]))
        if shown in _COLOURS:
            axis.axvspan(time[begin], time[end], color=_COLOURS[shown], alpha=0.25, linewidth=0.0, label=shown.name)
        begin = end + 1


def _arrays_of(tick: TickRecord) -> list[FloatArray]:
    state, command = tick.input.state, tick.output.command
    measured = (state.joint_position, state.joint_velocity, state.joint_effort)
    imu = (state.imu_quaternion, state.imu_angular_velocity, state.imu_linear_acceleration)
    return [*measured, *(getattr(command, name) for name in COMMAND_FIELDS), *imu]
