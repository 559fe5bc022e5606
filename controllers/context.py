"""What an observation term may read, and how live inputs behave when they are missing or too old."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.reference import Alignment, Frame, MotionReference
from humanoid_sim.controllers.terms import Term
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import EXTERN_WIDTHS, Extern, FloatArray, MITState

__all__ = ["ObservationContext", "Request", "Source", "live_input", "nan_when_stale", "zero_when_stale"]


@dataclass(frozen=True, slots=True, eq=False)
class ObservationContext:
    """Everything that a term may read."""

    state: MITState
    last_action: npt.NDArray[np.float32]
    """Shape (..., m), raw."""
    reference: MotionReference
    frame: Frame
    """Shape (...)."""
    alignment: Alignment | None = None
    """How the reference was laid onto the robot at activation."""
    phase: FloatArray = field(default_factory=lambda: np.empty(0))
    """Shape (..., k), rad."""


Source = Callable[[ObservationContext], Any]


@dataclass(frozen=True, slots=True)
class Request:
    """A term, and what there is to make it from."""

    kind: str
    """What the term means, one of the values of `TERM_KINDS`."""
    term: Term
    contract: PolicyContract
    robot_joints: tuple[str, ...]
    reference: MotionReference
    extern: Mapping[str, int]

    def missing(self, what: str) -> FieldError:
        """The refusal of a term whose source does not exist."""
        return FieldError(f"observation term '{self.term.name}' needs {what}, and there is none")


def live_input(state: MITState, name: str, width: int) -> Extern | None:
    """The live input, its shape checked: assigned unchecked, one value would fill every slot."""
    live = state.extern.get(name)
    if live is not None and live.value.shape not in ((width,), (*state.joint_position.shape[:-1], width)):
        raise FieldError(f"MITState.extern['{name}']: has shape {live.value.shape}, expected ({width},)")
    return live


def zero_when_stale(name: str, width: int) -> Source:
    """A live input that is zero when it is missing or too old."""
    zeros = np.zeros(width)

    def source(context: ObservationContext) -> FloatArray:
        live = live_input(context.state, name, width)
        # Never heard counts like too old: nothing pressed, no velocity asked for.
        return zeros if live is None else live.at(context.state.time)

    return source


def nan_when_stale(state: MITState, name: str) -> FloatArray:
    """An estimate that is missing or too old: not a number, so that the policy stops instead of believing zeros."""
    width = EXTERN_WIDTHS[name]
    live = live_input(state, name, width)
    if live is None:
        return np.full(width, np.nan)
    fresh = np.asarray(state.time) - live.arrival_time <= live.timeout
    return np.where(fresh[..., None], live.value, np.nan)
