"""The observation of a policy: terms resolved once, then packed in order without string work.

Environment, player and robot share these functions; they take `(..., n)`, one robot or a batch, and a batch gives bit
for bit what its robots give one by one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from humanoid_sim.controllers.contract import HistoryLayout, PolicyContract, Term
from humanoid_sim.controllers.parameters import joint_indices
from humanoid_sim.controllers.reference import MotionReference
from humanoid_sim.controllers.terms import BoundTerm, TermInput
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import Float32Array


@dataclass(frozen=True, slots=True)
class ObservationLayout:
    """The terms of a flat observation in their order."""

    terms: tuple[BoundTerm, ...]
    history_layout: HistoryLayout = "per_term"
    width: int = field(init=False)  # N, the number of values of the whole observation
    step_width: int = field(init=False)  # number of values of one step
    history: int = field(init=False)  # steps that the longest term shows

    def __post_init__(self) -> None:
        object.__setattr__(self, "width", sum(term.width for term in self.terms))
        object.__setattr__(self, "step_width", self.terms[-1].stop if self.terms else 0)
        object.__setattr__(self, "history", max((term.term.history for term in self.terms), default=1))

    def locate(self, index: int) -> str:
        """Name the value at `index` of the whole observation: `joint_pos[3]`, `joint_pos[3] of history step 1`."""
        term, step, value = self._place(index)
        return f"{term.name}[{value}]" + (f" of history step {step}" if term.term.history > 1 else "")

    def term_at(self, index: int) -> BoundTerm:
        return self._place(index)[0]

    def _place(self, index: int) -> tuple[BoundTerm, int, int]:
        """Return term, step of its history, and number of the value within it."""
        if self.history_layout == "per_step":
            step, within = divmod(index, self.step_width)
            term = next(term for term in self.terms if within < term.stop)
            return term, step, within - term.start
        for term in self.terms:
            if index < term.width:
                return term, *divmod(index, term.stop - term.start)
            index -= term.width
        raise IndexError(index)


def resolve_observation(
    contract: PolicyContract, robot_joints: tuple[str, ...], reference: MotionReference, extern: Mapping[str, int]
) -> ObservationLayout:
    """Look every term up once: `robot_joints` orders the state's arrays, `extern` has names and widths of live inputs.

    Raises `FieldError` for an unknown term, one whose source is missing, or one whose scale does not fit.
    """
    terms: list[BoundTerm] = []
    for term in contract.terms:
        kind, start = contract.kind(term), terms[-1].stop if terms else 0
        shown = contract.joint_names if term.joints is None else term.joints
        order = joint_indices(shown, robot_joints, "joint_names of the policy")
        pose = contract.default_joint_pos[[contract.joint_names.index(joint) for joint in shown]]
        is_plain = term.clip is None and bool(np.all(np.equal(term.scale, 1.0)))
        zero = pose if kind.is_relative(term) else 0.0
        bound = BoundTerm(term, kind, contract, reference, extern, order, zero, is_plain, start)
        width, size = bound.stop - start, np.size(term.scale)
        if size not in (1, width):
            raise FieldError(f"observation term '{term.name}': scale has {size} values, expected 1 or {width}")
        terms.append(bound)
    return ObservationLayout(tuple(terms), contract.history_layout)


def pack(layout: ObservationLayout, now: TermInput) -> Float32Array:
    """Return the values of this step, shape (..., step_width), float32; what a float32 cannot hold becomes infinite.

    Where no term shows a history this is the observation. Raises `FieldError` if a live term has another width than the
    one it was resolved with.
    """
    step = np.empty((*now.state.joint_position.shape[:-1], layout.step_width), dtype=np.float32)
    with np.errstate(over="ignore", invalid="ignore"):  # the caller checks that the result is finite
        for term in layout.terms:
            value = term.kind.value(term, now)
            step[..., term.start : term.stop] = value if term.is_plain else term.term.process(value)
    return step


def stack(
    layout: ObservationLayout, step: Float32Array, history: Float32Array | None
) -> tuple[Float32Array, Float32Array | None]:
    """Put this step's values behind those of the steps before it.

    Args:
        step: shape (..., step_width), from `pack`.
        history: shape (..., history, step_width), oldest first; None in the first step, which then stands for all of
            the past, as in Isaac Lab's buffers.

    Returns:
        The observation, shape (..., N), and the history for the next step; None where no term needs one.
    """
    if layout.history == 1:
        return step, None
    newest = step[..., None, :]
    if history is None:
        steps = np.repeat(newest, layout.history, axis=-2)
    else:
        steps = np.concatenate([history[..., 1:, :], newest], axis=-2)
    steps.setflags(write=False)
    if layout.history_layout == "per_step":
        return _flattened(steps, layout.terms[0].term), steps
    parts = [_flattened(steps[..., -term.term.history :, term.start : term.stop], term.term) for term in layout.terms]
    return np.concatenate(parts, axis=-1), steps


def _flattened(steps: Float32Array, term: Term) -> Float32Array:
    """Return values of several steps, shape (..., h, width), oldest first, as a term orders them: a copy."""
    ordered = steps if term.history_order == "oldest_first" else steps[..., ::-1, :]
    return ordered.reshape(*steps.shape[:-2], -1).copy()
