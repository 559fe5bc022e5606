"""An ONNX model in ONNX Runtime, and as a policy: one observation in, one action out, on one thread."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from threading import Timer
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.contract import TensorNames
from humanoid_sim.errors import InputError, blaming, reason_of, require_known
from humanoid_sim.files import regular_file
from humanoid_sim.mit import Float32Array

_NUMBERS = {"tensor(float)": np.float32, "tensor(int64)": np.int64, "tensor(int32)": np.int32}
_SOURCE = re.compile(r"\) (?=[A-Z])|\.(?:cc|h):\d+ \w+ |failed:")  # ends ONNX Runtime's place in its own source
_LOOPS = (b"Loop", b"Scan", b"SequenceMap")  # operators that repeat others, as their names stand in a file
_SILENT = 4  # ONNX Runtime's severity of what it prints: fatal errors only


class Tensor(NamedTuple):
    """An input or output of a model."""

    name: str
    type: str  # as ONNX Runtime calls it: `tensor(float)`
    shape: tuple[int | str | None, ...]  # a text or None stands for a size that is left open

    @property
    def width(self) -> int | None:
        """Values of one row of a (1, width) tensor; None for any other tensor."""
        if len(self.shape) != 2 or (isinstance(self.shape[0], int) and self.shape[0] != 1):
            return None
        return self.shape[1] if isinstance(self.shape[1], int) else None

    def __str__(self) -> str:
        return f"'{self.name}' is {self.type} of shape {list(self.shape)}"


class OnnxModel:
    """A model that is loaded and can be run."""

    def __init__(self, path: Path) -> None:
        _check_file(path)
        onnxruntime = onnx_runtime()
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1  # no spinning workers beside the control loop
        options.log_severity_level = _SILENT  # what it would log reaches the user through the exception
        try:
            self._session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        except Exception as error:  # of types that differ between builds
            reason = _SOURCE.split(reason_of(error))[-1]
            raise InputError(f"{path}: is not a model that ONNX Runtime can load: {reason}") from None
        self.path = path
        self.inputs, self.outputs = (
            tuple(Tensor(node.name, node.type, tuple(node.shape)) for node in nodes)
            for nodes in (self._session.get_inputs(), self._session.get_outputs())
        )
        self.metadata: Mapping[str, str] = dict(self._session.get_modelmeta().custom_metadata_map)
        self.time_limit = 10.0  # s after which an inference is ended, where the graph can loop
        content = path.read_bytes()
        self._can_loop = any(name in content for name in _LOOPS)
        if len(self.inputs) > 1:
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
        names = [tensor.name for tensor in self.inputs]
        bundle = self.path.with_suffix(".yaml")
        text = bundle.read_text(encoding="utf-8", errors="replace") if os.path.isfile(bundle) else ""
        if re.search(r"^models:", text, re.MULTILINE) and re.search(r"^pipeline:", text, re.MULTILINE):
            what = f"is a LEAPP bundle, which {bundle.name} beside it describes, of {len(names)} inputs"
            raise InputError(f"{self.path}: {what} ({', '.join(names)}): export the network with one observation")
        outputs = {tensor.name: tensor.shape for tensor in self.outputs}
        fed_back = [name for name in names if "_in" in name and name.replace("_in", "_out") in outputs]
        if state := fed_back or [tensor.name for tensor in self.inputs if len(tensor.shape) == 3]:
            raise InputError(f"{self.path}: is recurrent: its hidden state ({', '.join(state)}) is not carried here")
        others = [tensor for tensor in self.inputs[1:] if "time_step" not in tensor.name]
        if alike := [tensor.name for tensor in others if tensor.shape in list(outputs.values())[1:]]:
            what = f"beside {names[0]} it has {', '.join(alike)}, of the shape of an output"
            raise InputError(f"{self.path}: is recurrent, or has a second observation: {what}; neither is carried here")


def onnx_runtime() -> Any:
    """Import ONNX Runtime, which is heavy and may be missing, with its telemetry and its database in $HOME off."""
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    with blaming("a policy needs onnxruntime: pip install onnxruntime", ImportError):
        import onnxruntime  # noqa: PLC0415 - see above
    onnxruntime.set_default_logger_severity(_SILENT)  # it would warn of a graphics card that it does not find
    return onnxruntime


def has_onnxruntime() -> bool:
    """Return True if ONNX Runtime can be imported on this machine."""
    try:
        onnx_runtime()
    except InputError:
        return False
    return True


def read_metadata(path: Path) -> Mapping[str, str]:
    """Return the metadata of a checkpoint without ONNX Runtime."""
    import onnx  # noqa: PLC0415 - heavy, and only needed where onnxruntime is missing

    _check_file(path)
    with blaming(f"{path}: is not an ONNX model", Exception):  # protobuf's own types
        return {entry.key: entry.value for entry in onnx.load(str(path), load_external_data=False).metadata_props}


def _check_file(path: Path) -> None:
    """Refuse what cannot be an ONNX file."""
    with regular_file(path, "an ONNX file").open("rb") as file:
        start = file.read(2)
    if start in (b"", b"PK") or path.suffix.lower() in (".pt", ".pth", ".zip"):  # PyTorch writes ZIP archives
        raise InputError(f"{path}: is no ONNX file: export the policy as ONNX")


class OnnxPolicy:
    """`(observation (N,), frame) -> action (m,)`, float32. A model with a `time_step` input gets the frame there."""

    def __init__(self, model: OnnxModel, tensors: TensorNames) -> None:
        self.model = model
        inputs = {tensor.name: tensor for tensor in model.inputs}
        outputs = {tensor.name: tensor for tensor in model.outputs}
        where = f"{model.path}: "
        self._time_step = tensors.time_step or ("time_step" if "time_step" in inputs and len(inputs) > 1 else "")
        self._observation = tensors.observation or next((name for name in inputs if name != self._time_step), "")
        likely = [name for name in outputs if name in ("action", "actions")] or list(outputs)
        if not tensors.action and len(likely) > 1:
            many = f"has the outputs {', '.join(outputs)}"
            raise InputError(f"{where}{many}, expected tensors.action in x.contract.yaml to name one")
        self._action = tensors.action or likely[0]
        named = [name for name in (self._time_step, self._observation) if name]
        require_known("input", named, inputs, where)
        require_known("output", [self._action], outputs, where)
        if not self._observation or inputs.keys() != set(named):
            found = f"has the inputs {', '.join(inputs) or 'none'}"
            raise InputError(f"{where}{found}, expected one observation, and at most 'time_step' beside it")
        self.has_time_step = bool(self._time_step)
        self.observation_width = _row(where, "input", inputs[self._observation])
        self.action_width = _row(where, "output", outputs[self._action])
        if self._time_step:
            time_step = inputs[self._time_step]
            if time_step.width != 1 or time_step.type not in _NUMBERS:
                raise InputError(f"{where}input {time_step}, expected a number of shape (1, 1)")
            self._frame_type = _NUMBERS[time_step.type]

    def __call__(self, observation: Float32Array, frame: int) -> Float32Array:
        """One inference, of one robot."""
        action: Float32Array = self.run([self._action], observation, frame)[0][0]
        return action

    def run(self, outputs: list[str], observation: Float32Array, frame: int) -> list[Float32Array]:
        """Any outputs of one inference, each as the model gives it, shape (1, …)."""
        inputs: dict[str, npt.NDArray[Any]] = {self._observation: observation[None]}
        if self._time_step:
            inputs[self._time_step] = np.array([[frame]], dtype=self._frame_type)
        return self.model.run(outputs, inputs)


def _row(where: str, kind: str, tensor: Tensor) -> int:
    if tensor.width is None or tensor.type != "tensor(float)":
        raise InputError(f"{where}{kind} {tensor}, expected tensor(float) of shape (1, width)")
    return tensor.width
