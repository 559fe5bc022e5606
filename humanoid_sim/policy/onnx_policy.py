"""An ONNX model in ONNX Runtime, and as a policy: one observation in, one action out, on one thread."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Timer
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.contract import TensorNames
from humanoid_sim.errors import InputError, reason_of
from humanoid_sim.files import is_file, regular_file
from humanoid_sim.mit import Float32Array

ONNX_SECONDS = 10.0
"""s of one inference of a model whose graph can loop; on hardware much less, see `play`."""
_ACTIONS = ("actions", "action")
_TIME_STEP = "time_step"
_NUMBERS = {"tensor(float)": np.float32, "tensor(int64)": np.int64, "tensor(int32)": np.int32}
_LOOPS = (b"Loop", b"Scan", b"SequenceMap")  # operators that repeat others, as their names stand in a file
_SILENT = 4  # ONNX Runtime's severity of what it prints: fatal errors only
_OF_TRAINERS = {
    ".pt": ("a PyTorch checkpoint", "export it to ONNX first"),
    ".pth": ("a PyTorch checkpoint", "export it to ONNX first"),
    ".zip": ("a stable-baselines3 checkpoint", "give the policy.onnx beside it"),
}
"""By a file's suffix: what trainers call so, and what to do."""


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

    def __init__(self, path: Path) -> None:
        """Load a model.

        Raises `InputError` if the file is not an ONNX model, its external tensors are missing, or its graph is of a
        kind that no policy here can have: a LEAPP bundle's, or a recurrent network's.
        """
        check_file(path)
        onnxruntime = onnx_runtime()
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        options.inter_op_num_threads = 1
        options.execution_mode = onnxruntime.ExecutionMode.ORT_SEQUENTIAL
        options.log_severity_level = _SILENT  # what it would log reaches the user through the exception
        try:
            session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime raises its own types, which differ between builds
            raise InputError(f"{path}: is not a model that ONNX Runtime can load: {reason_of(error)}") from None
        self.path = path
        self.inputs = tuple(Tensor(node.name, node.type, tuple(node.shape)) for node in session.get_inputs())
        self.outputs = tuple(Tensor(node.name, node.type, tuple(node.shape)) for node in session.get_outputs())
        self.metadata: dict[str, str] = dict(session.get_modelmeta().custom_metadata_map)
        self.time_limit = ONNX_SECONDS
        """s after which an inference is ended, where the graph can loop; any other takes as long as the one before."""
        self._session = session
        content = path.read_bytes()
        self._can_loop = any(name in content for name in _LOOPS)
        self._refuse_other_kinds()

    def run(self, outputs: Sequence[str], inputs: dict[str, npt.NDArray[Any]]) -> list[Float32Array]:
        """Compute some outputs; raises whatever ONNX Runtime raises, and `TimeoutError` beyond the limit."""
        if not self._can_loop:
            return self._session.run(list(outputs), inputs)  # type: ignore[no-any-return]
        options = onnx_runtime().RunOptions()
        options.log_severity_level = _SILENT
        watch = Timer(self.time_limit, setattr, (options, "terminate", True))  # looked at between two operators
        watch.daemon = True
        watch.start()
        try:
            return self._session.run(list(outputs), inputs, options)  # type: ignore[no-any-return]
        except Exception:
            if options.terminate:
                raise TimeoutError(f"its graph loops: not done after {self.time_limit:g} s") from None
            raise
        finally:
            watch.cancel()
            watch.join()

    def _refuse_other_kinds(self) -> None:
        """Refuse graphs that would need more than one observation."""
        if len(self.inputs) < 2:
            return
        names, outputs = [tensor.name for tensor in self.inputs], [tensor.name for tensor in self.outputs]
        bundle = self.path.with_suffix(".yaml")
        text = bundle.read_text(encoding="utf-8", errors="replace") if is_file(bundle) else ""
        if re.search(r"^models:", text, re.MULTILINE) and re.search(r"^pipeline:", text, re.MULTILINE):
            raise InputError(
                f"{self.path}: is a LEAPP bundle, which {bundle.name} beside it describes; a graph of {len(names)} "
                f"inputs ({', '.join(names)}) is not supported: export the network with one observation"
            )
        fed_back = [name for name in names if "_in" in name and name.replace("_in", "_out") in outputs]
        state = fed_back or [tensor.name for tensor in self.inputs if len(tensor.shape) == 3]
        if state:
            raise InputError(f"{self.path}: is recurrent: its hidden state ({', '.join(state)}) is not carried here")


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
        raise InputError(f"{path}: is not an ONNX model: {reason_of(error)}") from None
    metadata = {entry.key: entry.value for entry in model.metadata_props}
    return metadata, tuple(output.name for output in model.graph.output)


def check_file(path: Path) -> None:
    """Refuse what cannot be an ONNX file."""
    own, instead = _OF_TRAINERS.get(path.suffix.lower(), ("", ""))
    if own:
        what = f"is {own}" if is_file(path) else "no such file"
        raise InputError(f"{path}: {what}, expected an ONNX file: {instead}")
    if regular_file(path, "an ONNX file").stat().st_size == 0:
        raise InputError(f"{path}: is empty, expected an ONNX file")


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
        time_step = next((tensor for tensor in inputs if tensor.name == _TIME_STEP and len(inputs) > 1), None)
        if tensors.time_step:
            time_step = _named(path, "input", inputs, tensors.time_step)
        others = [tensor for tensor in inputs if tensor is not time_step]
        if tensors.observation:
            _named(path, "input", inputs, tensors.observation)
        if len(others) != 1 or tensors.observation not in ("", others[0].name) or not outputs:
            names = ", ".join(tensor.name for tensor in inputs) or "none"
            raise InputError(
                f"{path}: has the inputs {names} and {len(outputs)} outputs, expected one input, or one and "
                f"'{_TIME_STEP}', and an output"
            )
        if time_step is not None and (time_step.type not in _NUMBERS or time_step.width != 1):
            raise _wrong_form(path, "input", time_step, "a number of shape (1, 1)")
        usual = [tensor for tensor in outputs if tensor.name in _ACTIONS]
        action = _named(path, "output", outputs, tensors.action) if tensors.action else (usual or outputs)[0]
        self.observation_width = _vector_width(path, "input", others[0])
        self.action_width = _vector_width(path, "output", action)
        self.has_time_step = time_step is not None
        self._action, self._observation, self._time_step = action.name, others[0].name, time_step

    def __call__(self, observation: Float32Array, frame: int) -> Float32Array:
        """One inference, of one robot."""
        if observation.shape != (self.observation_width,):
            expected = f"({self.observation_width},), of one robot"
            raise InputError(f"observation: has shape {observation.shape}, expected {expected}")
        action: Float32Array = self.run([self._action], observation, frame)[0][0]
        return action

    def run(self, outputs: list[str], observation: Float32Array, frame: int) -> list[Float32Array]:
        """Any outputs of one inference, each as the model gives it, shape (1, …)."""
        inputs: dict[str, npt.NDArray[Any]] = {self._observation: observation[None]}
        if self._time_step is not None:
            inputs[self._time_step.name] = np.array([[frame]], dtype=_NUMBERS[self._time_step.type])
        return self.model.run(outputs, inputs)


def _named(path: Path, kind: str, tensors: tuple[Tensor, ...], name: str) -> Tensor:
    for tensor in tensors:
        if tensor.name == name:
            return tensor
    raise InputError(f"{path}: has no {kind} '{name}'; its {kind}s are {', '.join(t.name for t in tensors) or 'none'}")


def _vector_width(path: Path, kind: str, tensor: Tensor) -> int:
    if tensor.type != "tensor(float)" or tensor.width is None:
        raise _wrong_form(path, kind, tensor, "tensor(float) of shape (1, width)")
    return tensor.width


def _wrong_form(path: Path, kind: str, tensor: Tensor, expected: str) -> InputError:
    what = f"{tensor.type} of shape {list(tensor.shape)}"
    return InputError(f"{path}: {kind} '{tensor.name}' is {what}, expected {expected}")
