"""Live inputs that Python code feeds: what no kind of observation term expresses, of the width that a term declares."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.errors import FieldError, known_names
from humanoid_sim.mit import Extern, MITState

LiveInput = Callable[[MITState], npt.ArrayLike]
"""Given the reported state, the value: shape (width,), in the term's own unit; (..., width) for a batch."""


@dataclass(frozen=True, slots=True)
class LiveInputs:
    """Sources of a policy's live inputs, by name. Resolving the terms finds what is missing."""

    contract: PolicyContract
    sources: Mapping[str, LiveInput] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in self.sources:
            if name not in self.contract.sent_inputs:
                raise FieldError(f"live: {known_names('live input', name, self.contract.sent_inputs)}")

    @property
    def widths(self) -> Mapping[str, int]:
        """Name and width of those that are fed."""
        return {name: width for name, width in self.contract.sent_inputs.items() if name in self.sources}

    def extend(self, state: MITState) -> MITState:
        """Return the state with the sources' values; where one is unfit, observing it is a fault."""
        if not self.sources:
            return state
        time = float(state.time) if np.ndim(state.time) == 0 else 0.0  # a batch's clocks differ; nothing grows too old
        live = dict(state.extern)
        for name, source in self.sources.items():
            value = np.atleast_1d(np.asarray(source(state), dtype=np.float64))
            if value.ndim == 1:  # one value for all robots
                value = np.broadcast_to(value, (*state.joint_position.shape[:-1], len(value)))
            live[name] = Extern(value, time)
        return replace(state, extern=live)
