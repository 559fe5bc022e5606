"""What a run of `play` left behind."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from humanoid_sim.messages import Event, TickRecord

Document = dict[str, Any]


@dataclass
class Result:
    """Status, output and files of one run."""

    status: int
    out: str
    err: str
    folder: Path
    ticks: list[TickRecord] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    summary: Document = field(default_factory=dict)

    @property
    def modes(self) -> list[str]:
        """The modes in the order in which they were entered."""
        return [span["mode"] for span in self.summary["modes"]]

    @property
    def reasons(self) -> list[str]:
        """Why each was entered."""
        return [span["reason"] for span in self.summary["modes"]]
