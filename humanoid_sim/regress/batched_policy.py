"""Inference for many robots at once, bit for bit what each of them would get alone.

ONNX Runtime has one thread here, as on the robot, so that a result depends neither on the machine's load nor, as is
tried out when a model is loaded, on how many observations are answered together.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
import onnx

from humanoid_sim.policy.onnx_model import OnnxModel
from humanoid_sim.policy.onnx_policy import OnnxPolicy
from humanoid_sim.regress.batch_axis import with_batch_axis
from humanoid_sim.regress.free_batch import UnsupportedGraphError, read_graph, with_free_shapes

__all__ = ["BatchedPolicy"]

Float32Array = npt.NDArray[np.float32]
_Batch = Callable[[Float32Array, npt.NDArray[np.integer]], Float32Array]

_TRIED_SIZES = (67, 2, 5)
"""Batches that must agree with single rows: matrix kernels treat rows in groups, and what is left of them otherwise."""


class BatchedPolicy:
    """`(observations (B, N), frames (B,)) -> raw actions (B, m)`, float32."""

    batching: str
    """How it is done, for a report: `free batch dimension in memory`, or `row by row` and why."""

    def __init__(self, policy: OnnxPolicy) -> None:
        """Try the ways of freeing the model's batch, the fastest first.

        Args:
            policy: the checkpoint; answers one observation at a time.
        """
        self._policy = policy
        self._batch: _Batch | None = None
        reasons = []
        for free in (with_batch_axis, with_free_shapes):
            try:
                batch = _freed(policy, free)
                if _agrees(policy, batch):
                    self._batch, self.batching = batch, "free batch dimension in memory"
                    return
                reasons.append("answers of a batch differ from those of single rows")
            except Exception as error:  # of onnx, its C++ checker or ONNX Runtime: whatever it is, rows remain
                reasons.append(_reason(error))
        self.batching = f"row by row: {reasons[0]}"

    def __call__(self, observation: Float32Array, frame: npt.NDArray[np.integer]) -> Float32Array:
        """All actions of one policy step; NaN for the rows of a model that raises."""
        if self._batch is None:
            return _row_by_row(self._policy, observation, frame)
        try:
            return self._batch(observation, frame)
        except Exception:  # an operator that fails on one row's values fails on the batch; the others go on
            return _row_by_row(self._policy, observation, frame)


def _row_by_row(policy: OnnxPolicy, observation: Float32Array, frame: npt.NDArray[np.integer]) -> Float32Array:
    actions = np.full((len(observation), policy.action_width), np.nan, dtype=np.float32)
    for i in range(len(observation)):
        try:
            actions[i] = policy(observation[i], int(frame[i]))
        except Exception:  # of ONNX Runtime; an action that is no number ends this episode, and only this one
            continue
    return actions


def _freed(policy: OnnxPolicy, free: Callable[[onnx.ModelProto], onnx.ModelProto]) -> _Batch:
    output = policy.action_name
    model = OnnxModel(policy.model.path, free(read_graph(policy.model.path, output)).SerializeToString())
    present = {tensor.name for tensor in model.inputs}

    def batch(observation: Float32Array, frame: npt.NDArray[np.integer]) -> Float32Array:
        inputs: dict[str, npt.NDArray[Any]] = policy.inputs(observation, frame)
        answer = model.run([output], {name: value for name, value in inputs.items() if name in present})[0]
        if answer.shape != (len(observation), policy.action_width):
            raise ValueError(f"answers shape {answer.shape}")
        return answer

    return batch


def _agrees(policy: OnnxPolicy, batch: _Batch) -> bool:
    """Whether batches of several sizes give bit for bit what single observations give."""
    generator = np.random.default_rng(0)
    count = max(_TRIED_SIZES)
    observation = generator.standard_normal((count, policy.observation_width)).astype(np.float32)
    frame = np.arange(count)
    rows = _row_by_row(policy, observation, frame)
    return all(
        batch(observation[part], frame[part]).tobytes() == rows[part].tobytes()
        for size in _TRIED_SIZES
        for part in _parts(count, size)
    )


def _parts(count: int, size: int) -> Iterator[slice]:
    return (slice(begin, begin + size) for begin in range(0, count, size))


def _reason(error: Exception) -> str:
    if isinstance(error, UnsupportedGraphError):
        return f"the model has {error}"
    return f"{type(error).__name__} while freeing the model's batch"
