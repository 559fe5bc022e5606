"""Inference for many robots at once, bit for bit what each of them would get alone.

Exporters often declare a batch of one and compute row by row all the same. Such a model gets its batch declared open,
in memory. A batch then runs as one inference, unless its answers differ from those of single rows, which is tried out
when a model is loaded. ONNX Runtime has one thread here, as on the robot: a result depends neither on the machine's
load nor on how many observations are answered together.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import onnx

from humanoid_sim.policy.onnx_policy import OnnxModel, OnnxPolicy

Float32Array = npt.NDArray[np.float32]

_TRIED_SIZES = (67, 2, 5)
"""Batches that must agree with single rows: matrix kernels treat rows in groups, and what is left of them otherwise."""


class BatchedPolicy:
    """`(observations (B, N), frames (B,)) -> raw actions (B, m)`, float32."""

    batching: str
    """Kind of inference, for a report: `in batches`, or `row by row` and why."""

    def __init__(self, policy: OnnxPolicy) -> None:
        """Try out whether the model of a policy answers a batch as it answers single rows."""
        self._policy = policy
        self._model: OnnxModel | None = None
        try:
            model = OnnxModel(policy.model.path, _with_open_batch(policy))
            agrees = self._agrees(model)
        except Exception:  # of onnx, its C++ checker or ONNX Runtime: whatever it is, rows remain
            self.batching = "row by row: the model runs on no batch"
            return
        self._model = model if agrees else None
        self.batching = "in batches" if agrees else "row by row: in a batch its answers differ"

    def __call__(self, observation: Float32Array, frame: npt.NDArray[np.integer]) -> Float32Array:
        """All actions of one policy step; NaN for the rows of a model that raises."""
        if self._model is None:
            return self._row_by_row(observation, frame)
        try:
            return self._batch(self._model, observation, frame)
        except Exception:  # an operator that fails on one row's values fails on the batch; the others go on
            return self._row_by_row(observation, frame)

    def _batch(self, model: OnnxModel, observation: Float32Array, frame: npt.NDArray[np.integer]) -> Float32Array:
        return model.run([self._policy.action_name], self._policy.inputs(observation, frame))[0]

    def _row_by_row(self, observation: Float32Array, frame: npt.NDArray[np.integer]) -> Float32Array:
        actions = np.full((len(observation), self._policy.action_width), np.nan, dtype=np.float32)
        for i in range(len(observation)):
            try:
                actions[i] = self._policy(observation[i], int(frame[i]))
            except Exception:  # of ONNX Runtime; an action that is not a number ends this episode, and only this one
                continue
        return actions

    def _agrees(self, model: OnnxModel) -> bool:
        """Return whether batches of several sizes give bit for bit what single observations give."""
        count = max(_TRIED_SIZES)
        shape = (count, self._policy.observation_width)
        observation = np.random.default_rng(0).standard_normal(shape).astype(np.float32)
        frame = np.arange(count)
        rows = self._row_by_row(observation, frame)
        parts = [slice(begin, begin + size) for size in _TRIED_SIZES for begin in range(0, count, size)]
        answers = ((self._batch(model, observation[part], frame[part]), rows[part]) for part in parts)
        return all(batch.shape == alone.shape and batch.tobytes() == alone.tobytes() for batch, alone in answers)


def _with_open_batch(policy: OnnxPolicy) -> bytes:
    """Return what the action is computed by, with the first dimension of inputs and action declared open.

    A motion that shares the graph is left out: it costs time at every step, and may not be made for batches.
    """
    model = onnx.load(str(policy.model.path))
    graph, needed = model.graph, {policy.action_name}
    for node in reversed(list(graph.node)):
        if needed.isdisjoint(node.output):
            graph.node.remove(node)
        else:
            needed.update(node.input)
    for value in [value for value in graph.output if value.name != policy.action_name]:
        graph.output.remove(value)
    constants = {tensor.name for tensor in graph.initializer}  # old models list them among the inputs
    for value in [*graph.input, *graph.output]:
        if value.name not in constants:
            value.type.tensor_type.shape.dim[0].dim_param = "batch"
    del graph.value_info[:]
    serialized: bytes = model.SerializeToString()
    return serialized
