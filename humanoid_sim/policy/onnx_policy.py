"""An ONNX model in ONNX Runtime, and as a policy: one observation in, one action out, on one thread."""

from __future__ import annotations

import mmap
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Timer
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.contract import TensorNames
from humanoid_sim.errors import InputError
from humanoid_sim.files import is_file, regular_file
from humanoid_sim.mit import Float32Array

ONNX_SECONDS = 10.0
"""s of one inference of a model whose graph can loop; on hardware much less, see `play`."""
_ACTIONS = ("actions", "action")
_TIME_STEP = "time_step"
_NUMBERS = {"tensor(float)": np.float32, "tensor(int64)": np.int64, "tensor(int32)": np.int32}


@dataclass(frozen=True, slots=True)
class Tensor:
    """An input or output of a model."""

    name: str
    type: str
    """As ONNX Runtime calls it: `tensor(float)`."""
    shape: tuple[int | str | None, ...]
    """A text or None stands for a size that is left open."""

    @property
    def width(self) -> int | None:
        """Values of one row of a (1, width) tensor of numbers; None for any other tensor."""
        if len(self.shape) != 2 or (isinstance(self.shape[0], int) and self.shape[0] != 1):
            return None
        return self.shape[1] if isinstance(self.shape[1], int) else None


class OnnxModel:
    """A model that is loaded and can be run.

    One thread and sequential execution: results do not depend on the machine's load, and no pool of spinning workers
    competes with the control loop.
    """

    def __init__(self, path: Path, graph: bytes | None = None) -> None:
        """Load a model.

        Raises `InputError` if the file is not an ONNX model, or its external tensors are missing.

        Args:
            graph: a model that was made from the file's and is to run in its place; None: the file's own.
        """
        check_file(path)
        onnxruntime = onnx_runtime()
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        options.inter_op_num_threads = 1
        options.execution_mode = onnxruntime.ExecutionMode.ORT_SEQUENTIAL
        options.log_severity_level = _SILENT  # what it would log reaches the user through the exception
        try:
            source = str(path) if graph is None else graph
            session = onnxruntime.InferenceSession(source, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime raises its own types, which differ between builds
            if isinstance(error, UnicodeDecodeError):
                raise InputError(f"{path}: a name in its graph is not text (UTF-8)") from None
            raise InputError(f"{path}: is not a model that ONNX Runtime can load: {first_line(error)}") from None
        self.path = path
        try:
            self.inputs = tuple(Tensor(node.name, node.type, tuple(node.shape)) for node in session.get_inputs())
            self.outputs = tuple(Tensor(node.name, node.type, tuple(node.shape)) for node in session.get_outputs())
            self.metadata: dict[str, str] = dict(session.get_modelmeta().custom_metadata_map)
        except UnicodeDecodeError:
            raise InputError(f"{path}: its metadata, or a tensor's name, is not text (UTF-8)") from None
        self._session = session
        self.time_limit = ONNX_SECONDS
        """s after which an inference is ended, where the graph can loop; any other takes as long as the one before."""
        self.can_loop = _can_loop(path) if graph is None else any(name in graph for name in _LOOPS)
        """True if the graph has an operator that repeats others, as often as its inputs say."""

    def run(self, outputs: Sequence[str], inputs: dict[str, npt.NDArray[Any]]) -> list[Float32Array]:
        """Compute some outputs; raises whatever ONNX Runtime raises, and `TimeoutError` beyond the limit."""
        if self.can_loop:
            return self._run_in_time(outputs, inputs)
        values: list[Float32Array] = self._session.run(list(outputs), inputs)
        return values

    def _run_in_time(self, outputs: Sequence[str], inputs: dict[str, npt.NDArray[Any]]) -> list[Float32Array]:
        """ONNX Runtime looks at the flag between two operators, also those within a loop."""
        options = onnx_runtime().RunOptions()
        options.log_severity_level = _SILENT
        watch = Timer(self.time_limit, setattr, (options, "terminate", True))
        watch.daemon = True
        watch.start()
        try:
            values: list[Float32Array] = self._session.run(list(outputs), inputs, options)
        except Exception:
            if options.terminate:
                raise TimeoutError(f"its graph loops: not done after {self.time_limit:g} s") from None
            raise
        finally:
            watch.cancel()
            watch.join()
        return values


_LOOPS = (b"Loop", b"Scan", b"SequenceMap")
"""Operators that repeat others, as their names stand in a file."""


def _can_loop(path: Path) -> bool:
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        return any(content.find(name) >= 0 for name in _LOOPS)


_SILENT = 4
"""ONNX Runtime's severity of what it prints: fatal errors only."""


def onnx_runtime() -> Any:
    """ONNX Runtime, imported when it is first needed, because it is heavy and may be missing.

    By default it keeps a database in the user's home and reports to its makers from a thread of its own: nothing that
    belongs beside a control loop, on a machine that may be offline.
    """
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    import onnxruntime  # noqa: PLC0415 - see above

    onnxruntime.set_default_logger_severity(_SILENT)  # it would warn of a graphics card that it does not find
    return onnxruntime


def has_onnxruntime() -> bool:
    """Return whether ONNX Runtime can be imported on this machine."""
    try:
        onnx_runtime()
    except ImportError:
        return False
    return True


def read_header(path: Path) -> tuple[dict[str, str], tuple[str, ...]]:
    """Return the metadata of a checkpoint and the names of its outputs, without ONNX Runtime."""
    import onnx  # noqa: PLC0415 - heavy, and only needed where onnxruntime is missing

    check_file(path)
    try:
        model = onnx.load(str(path), load_external_data=False)
    except Exception as error:  # protobuf's exception type is not part of onnx's interface
        raise InputError(f"{path}: is not an ONNX model: {first_line(error)}") from None
    metadata = {entry.key: entry.value for entry in model.metadata_props}
    outputs = tuple(output.name for output in model.graph.output)
    if not all(isinstance(text, str) for text in (*metadata, *metadata.values(), *outputs)):  # protobuf gives bytes
        raise InputError(f"{path}: its metadata, or a tensor's name, is not text (UTF-8)")
    return metadata, outputs


_OF_TRAINERS = {
    ".pt": ("a PyTorch checkpoint", "export it to ONNX first"),
    ".pth": ("a PyTorch checkpoint", "export it to ONNX first"),
    ".zip": ("a stable-baselines3 checkpoint", "give the policy.onnx beside it"),
}
"""By a file's suffix: what trainers call so, and what to do."""


def check_file(path: Path) -> None:
    """Refuse what cannot be an ONNX file."""
    own, instead = _OF_TRAINERS.get(path.suffix.lower(), ("", ""))
    if own:
        what = f"is {own}" if is_file(path) else "no such file"
        raise InputError(f"{path}: {what}, expected an ONNX file: {instead}")
    if regular_file(path, "an ONNX file").stat().st_size == 0:
        raise InputError(f"{path}: is empty, expected an ONNX file")


def first_line(error: Exception) -> str:
    """Return what an exception says, cut to its first line."""
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__


def external_file(path: Path) -> Path:
    """Return where exporters put a model's external tensors; there need be no such file."""
    return path.with_name(f"{path.name}.data")


class OnnxPolicy:
    """`(observation (N,), frame) -> action (m,)`, float32. A model with a `time_step` input gets the frame there."""

    def __init__(self, model: OnnxModel | Path, tensors: TensorNames | None = None) -> None:
        """Find the tensors of a model and check their form.

        Raises `InputError` if there is not exactly one observation, float32 (1, N), beside an optional time_step, or no
        action, float32 (1, M).

        Args:
            tensors: names; those that are empty are found by their place.
        """
        self.model = OnnxModel(model) if isinstance(model, Path) else model
        tensors = TensorNames() if tensors is None else tensors
        path, inputs, outputs = self.model.path, self.model.inputs, self.model.outputs
        time_step = _time_step(path, inputs, tensors.time_step)
        others = [tensor for tensor in inputs if tensor is not time_step]
        observation = _named(path, "input", inputs, tensors.observation) if tensors.observation else None
        if observation is None:
            observation = others[0] if len(others) == 1 else None
        surplus = [tensor.name for tensor in others if tensor is not observation]
        if observation is None or surplus or not outputs:
            names = ", ".join(tensor.name for tensor in inputs) or "none"
            raise InputError(
                f"{path}: has the inputs {names} and {len(outputs)} outputs, expected one input, or one and "
                f"'{_TIME_STEP}', and an output"
            )
        usual = [tensor for tensor in outputs if tensor.name in _ACTIONS]
        action = _named(path, "output", outputs, tensors.action) if tensors.action else (usual or outputs)[0]
        self.observation_width = _vector_width(path, "input", observation)
        self.action_width = _vector_width(path, "output", action)
        self.has_time_step = time_step is not None
        self.action_name = action.name
        self._observation = observation.name
        self._time_step = "" if time_step is None else time_step.name
        self._frame_type = np.float32 if time_step is None else _NUMBERS[time_step.type]

    def __call__(self, observation: Float32Array, frame: int) -> Float32Array:
        """One inference, of one robot."""
        if observation.shape != (width := (self.observation_width,)):
            raise InputError(f"observation: has shape {observation.shape}, expected {width}, of one robot")
        action: Float32Array = self.run([self.action_name], observation, frame)[0][0]
        return action

    def run(self, outputs: list[str], observation: Float32Array, frame: int) -> list[Float32Array]:
        """Any outputs of one inference, each as the model gives it, shape (1, …)."""
        return self.model.run(outputs, self.inputs(observation[None], np.array([frame])))

    def inputs(self, observation: Float32Array, frame: npt.NDArray[np.integer]) -> dict[str, npt.NDArray[Any]]:
        """Return what goes into the model, by the names of its tensors, for observations (B, N) and frames (B,)."""
        inputs: dict[str, npt.NDArray[Any]] = {self._observation: observation}
        if self.has_time_step:
            inputs[self._time_step] = frame.astype(self._frame_type)[:, None]
        return inputs


def _time_step(path: Path, inputs: tuple[Tensor, ...], name: str) -> Tensor | None:
    """Return the input that selects a frame, by its name; by default the one that is called time_step."""
    tensor = _named(path, "input", inputs, name) if name else None
    if tensor is None:
        tensor = next((tensor for tensor in inputs if tensor.name == _TIME_STEP and len(inputs) > 1), None)
    if tensor is not None and (tensor.type not in _NUMBERS or tensor.width != 1):
        raise InputError(
            f"{path}: input '{tensor.name}' is {tensor.type} of shape {list(tensor.shape)}, "
            "expected a number of shape (1, 1)"
        )
    return tensor


def _named(path: Path, kind: str, tensors: tuple[Tensor, ...], name: str) -> Tensor:
    for tensor in tensors:
        if tensor.name == name:
            return tensor
    raise InputError(f"{path}: has no {kind} '{name}'; its {kind}s are {', '.join(t.name for t in tensors) or 'none'}")


def _vector_width(path: Path, kind: str, tensor: Tensor) -> int:
    if tensor.type != "tensor(float)":
        raise InputError(f"{path}: {kind} '{tensor.name}' is {tensor.type}, expected tensor(float)")
    if tensor.width is None:
        raise InputError(f"{path}: {kind} '{tensor.name}' has shape {list(tensor.shape)}, expected (1, width)")
    return tensor.width
