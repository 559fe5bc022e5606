"""Views of a page other than the state: plots, a piano's keys, motors and buses, and figures in the 3D view."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from humanoid_sim.frontends.attach import Attachment
from humanoid_sim.frontends.console.plots import Plots, bus_loads
from humanoid_sim.messages import SessionHeader, TickRecord
from humanoid_sim.mit import KEY_PRESSED, FloatArray
from humanoid_sim.recording.header import json_document
from humanoid_sim.rendering.ghost import ShownReference
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.motors import MOTORS
from humanoid_sim.robots.piano import KEY_COUNT
from humanoid_sim.stack import no_policy, recorded_policy

if TYPE_CHECKING:  # viser, which the rest of this module does without
    from humanoid_sim.frontends.console.scene import Scene

_SHOWN = 0.1
"""s for which a stroke is shown at least: pages are updated ten times a second."""


class ShownKeys:
    """Piano keys of one session, for all pages."""

    def __init__(self, header: SessionHeader) -> None:
        """Find the goals. Raises `InputError` if the header is damaged."""
        loaded = recorded_policy(header, no_policy)
        self._goals = None if loaded is None else loaded.reference.terms.get("target_keys")
        self._reference = ShownReference()
        self._last: FloatArray = np.full(KEY_COUNT, -np.inf)
        """Shape (88,), time at which each key was last down, s."""

    def look(self, record: TickRecord) -> None:
        """Take a tick, of which every one must be seen."""
        self._reference.look(record)
        now, heard = float(record.input.state.time), record.input.state.extern.get(KEY_PRESSED)
        if (self._last > now).any():  # time begins again after a reactivation
            self._last[:] = -np.inf
        if heard is not None and heard.value.shape == (KEY_COUNT,):
            self._last[heard.at(now) > 0.0] = now

    def told(self, record: TickRecord) -> dict[str, Any] | None:
        """For all pages; None of a session that has nothing to do with a piano.

        `down` and `wanted` are the numbers of keys, the lowest is 0: null while nobody knows which are down, and while
        no policy plays.
        """
        now, heard = float(record.input.state.time), record.input.state.extern.get(KEY_PRESSED)
        if heard is None and self._goals is None:
            return None
        frame = self._reference.frame
        is_known = heard is not None and now - heard.arrival_time <= heard.timeout
        wanted = None if self._goals is None or frame is None else np.flatnonzero(self._goals[frame]).tolist()
        return {"down": np.flatnonzero(self._last > now - _SHOWN).tolist() if is_known else None, "wanted": wanted}


class Showing:
    """Views of one session, for all pages."""

    def __init__(self, attachment: Attachment, scene: Scene) -> None:
        """Know what there is. Raises `InputError` if the session's header is damaged."""
        self._attachment, self._description = attachment, attachment.description
        self._robot: Mapping[str, Any] | None = None
        self._loads: Mapping[str, float] = {}
        self._scene, self._ghosts = scene, scene.ghosts
        self._switched: Any = scene.ghosts
        robot = attachment.feed.status().get("robot")
        self._channels = [] if robot is None else [channel["source"] for channel in robot["channels"]]
        header = attachment.header
        self._policy = json_document(header, "settings").get("policy")
        self._keys = ShownKeys(header)
        self.plots = Plots(header, self._description, self._channels, self._attachment.base)

    def hear(self, status: Mapping[str, Any]) -> None:
        """Take the feed's status."""
        self._switched = self._ghosts if status.get("simulation") is None else self._scene
        robot = status.get("robot")
        if robot != self._robot:
            self._loads = bus_loads(self._robot, robot)
            self._robot = robot

    def look(self, record: TickRecord) -> None:
        """Take a tick, of which every one must be seen."""
        self._ghosts.look(record)
        self._keys.look(record)
        self.plots.add(record, self._loads)

    def hello(self) -> dict[str, Any]:
        """For a page that is opened."""
        charts = self.plots.charts
        return {
            "robot": self._description.name,
            "policy": self._policy,
            "charts": [[chart.group, chart.name, chart.unit, chart.series] for chart in charts],
        }

    def told(self, record: TickRecord) -> dict[str, Any]:
        """For all pages, again and again; `record` is the newest tick."""
        return {
            "hardware": motor_table(self._description, self._robot, self._loads, record),
            "figures": self._switched.told(),
            "keys": self._keys.told(record),
        }

    def switch(self, name: object, *, on: object) -> str:
        """Switch a figure in the 3D view; why not, if it is refused."""
        if not isinstance(name, str) or not isinstance(on, bool):
            return "show not understood, expected the name of a figure, and on: true or false"
        return str(self._switched.switch(name, on=on))


def motor_table(
    description: RobotDescription, robot: Mapping[str, Any] | None, loads: Mapping[str, float], record: TickRecord
) -> dict[str, Any] | None:
    """Return motors and buses, as JSON; None in simulation.

    `robot` is what the feed's status tells of it; loads of the buses are 0 to 1.
    """
    if robot is None:
        return None
    temperature, faults = robot["temperature"], robot["faults"]
    ages = record.input.state.joint_age.tolist()
    motors = []
    for joint, age in zip(description.joints, ages, strict=True):
        model = MOTORS.get(joint.motor.model) if joint.motor is not None else None
        motors.append(
            {
                "name": joint.name,
                "temperature": temperature.get(joint.name),
                "warning": None if model is None else model.warning_temperature,
                "heard": age,
                "faults": faults.get(joint.name, []),
            }
        )
    buses = [{"name": channel["source"], "load": loads.get(channel["source"])} for channel in robot["channels"]]
    return {"motors": motors, "buses": buses}
