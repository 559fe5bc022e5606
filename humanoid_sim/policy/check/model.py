"""What the model itself does: its input's width, its answer to zeros, and which terms it listens to."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.observation import ObservationLayout
from humanoid_sim.errors import FieldError
from humanoid_sim.policy.check.finding import Finding
from humanoid_sim.policy.checkpoint import Checkpoint
from humanoid_sim.policy.widths import contract_layout

__all__ = ["model_findings"]

Float32Array = npt.NDArray[np.float32]

_LARGEST_ACTION = 100.0
"""The controller's own limit of a raw action."""
_PROBES = 4


def model_findings(checkpoint: Checkpoint) -> Iterator[Finding]:
    """Run the model on zeros and on noise; compare the width of its input with the terms'."""
    width = checkpoint.observation_width
    try:
        layout = contract_layout(checkpoint.contract, width)
    except FieldError as error:
        yield Finding("error", "observation", str(error))
        return
    if width is None:
        return
    if layout.width != width:
        terms = " + ".join(f"{term.name} {term.width}" for term in layout.terms)
        message = f"is {layout.width} wide ({terms}), but the model's input has {width}"
        yield Finding("error", "observation", message, value=layout.width, limit=width)
        return
    yield from _answers(checkpoint, width)
    yield from _deaf(checkpoint, layout)


def _answers(checkpoint: Checkpoint, width: int) -> Iterator[Finding]:
    action = np.abs(_run(checkpoint, np.zeros(width, dtype=np.float32)))
    joints = checkpoint.contract.action_joint_names
    if not np.isfinite(action).all():
        joint = joints[int(np.argmax(~np.isfinite(action)))]
        yield Finding("error", "model", "answers an observation of zeros with a number that is not finite", joint)
    elif action.max() > _LARGEST_ACTION:
        worst = int(np.argmax(action))
        message = f"answers an observation of zeros with {action[worst]:g}, expected at most {_LARGEST_ACTION:g}"
        yield Finding("error", "model", message, joints[worst], float(action[worst]), _LARGEST_ACTION)


def _deaf(checkpoint: Checkpoint, layout: ObservationLayout) -> Iterator[Finding]:
    """Terms whose values change nothing in the answer: a normaliser that has never seen them move, or a wrong place."""
    rng = np.random.default_rng(0)
    probes = rng.normal(0.0, 1.0, (_PROBES, layout.width)).astype(np.float32)
    owner = np.array([layout.locate(i).partition("[")[0] for i in range(layout.width)])
    answers = [_run(checkpoint, probe) for probe in probes]
    if all(np.array_equal(answer, answers[0]) for answer in answers):
        yield Finding("warning", "model", "gives the same action whatever it observes")
        return
    for term in layout.terms:
        silent = probes.copy()
        silent[:, owner == term.name] = 0.0
        if all(np.array_equal(_run(checkpoint, row), answers[i]) for i, row in enumerate(silent)):
            message = "has no influence on the model's answer"
            yield Finding("warning", f"observation term {term.name}", message)


def _run(checkpoint: Checkpoint, observation: Float32Array) -> Float32Array:
    return np.asarray(checkpoint.policy(observation, 0), dtype=np.float32)
