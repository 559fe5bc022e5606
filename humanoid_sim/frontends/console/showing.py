"""What pages are shown beside the state: plots, a piano's keys, motors and buses, and figures in the 3D view."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from humanoid_sim.frontends.attach import Attachment
from humanoid_sim.frontends.console.ghosts import Ghosts
from humanoid_sim.frontends.console.keys import ShownKeys
from humanoid_sim.frontends.console.motors import motor_table
from humanoid_sim.frontends.console.plots import Plots, Watch, bus_loads
from humanoid_sim.messages import TickRecord
from humanoid_sim.recording.settings import recorded_settings
from humanoid_sim.recording.shadow import ShadowStep

__all__ = ["Showing"]


class Showing:
    """Of one session, for all pages."""

    def __init__(self, attachment: Attachment, ghosts: Ghosts) -> None:
        """Know what there is. Raises `InputError` if the session's header is damaged."""
        self._attachment, self._description = attachment, attachment.description
        self._robot: Mapping[str, Any] | None = None
        self._loads: Mapping[str, float] = {}
        self._ghosts = ghosts
        robot = attachment.feed.status().get("robot")
        self._channels = [] if robot is None else [channel["source"] for channel in robot["channels"]]
        self._prepare()

    def _prepare(self) -> None:
        header = self._attachment.header
        self._policy = recorded_settings("the session", header).get("policy")
        self._keys = ShownKeys(header)
        self.plots = Plots(header, self._description, self._channels)

    def follow(self) -> None:
        """Show what belongs to the policy that was loaded. Raises `InputError` if its header is damaged."""
        self._prepare()
        self._ghosts.follow(self._attachment.reference_ghost())

    def hear(self, status: Mapping[str, Any]) -> None:
        """Take the feed's status."""
        robot = status.get("robot")
        if robot != self._robot:
            self._loads = bus_loads(self._robot, robot)
            self._robot = robot

    def look(self, record: TickRecord) -> None:
        """Take a tick, of which every one must be seen."""
        self._ghosts.look(record)
        self._keys.look(record)
        self.plots.add(record, self._loads)

    def shadow(self, step: ShadowStep) -> None:
        """Take a step of a shadow policy."""
        self.plots.shadow(step)

    def hello(self) -> dict[str, Any]:
        """For a page that is opened."""
        charts = self.plots.charts
        return {
            "policy": self._policy,
            "charts": [[chart.group, chart.name, chart.unit, chart.series] for chart in charts],
        }

    def told(self, record: TickRecord) -> dict[str, Any]:
        """For all pages, again and again; `record` is the newest tick."""
        return {
            "hardware": motor_table(self._description, self._robot, self._loads, record),
            "figures": self._ghosts.told(),
            "keys": self._keys.told(record),
        }

    def watch(self) -> Watch:
        """For a page: what it plots."""
        return Watch(self.plots)

    def switch(self, name: object, *, on: object) -> str:
        """Switch a figure in the 3D view; why not, if it is refused."""
        if not isinstance(name, str) or not isinstance(on, bool):
            return "show not understood, expected the name of a figure, and on: true or false"
        return self._ghosts.switch(name, on=on)
