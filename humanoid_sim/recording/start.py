"""The memory with which a recorded run began, if not with the control stack's own: a document of its header.

A branch begins in the middle of another run. Its memory is plain data of few types, which is kept bit for bit.
"""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from humanoid_sim.controllers.base import Memory
from humanoid_sim.controllers.damping import DampingMemory
from humanoid_sim.controllers.fsm import MODES
from humanoid_sim.controllers.guards import GuardMemory
from humanoid_sim.controllers.policy_step import PolicyMemory
from humanoid_sim.controllers.reference import Alignment
from humanoid_sim.controllers.remote_policy import RemoteMemory
from humanoid_sim.controllers.rl_policy import RLPolicyMemory
from humanoid_sim.controllers.signs import SignMemory
from humanoid_sim.controllers.standby import StandbyMemory
from humanoid_sim.controllers.supervisor import SupervisorMemory
from humanoid_sim.errors import blaming, known_names
from humanoid_sim.messages import PolicyStep, SessionHeader, StandbyState
from humanoid_sim.mit import MITCommand
from humanoid_sim.strict_json import parse_json

START_DOCUMENT = "start"

_TYPES: Mapping[str, type[Any]] = {
    kind.__name__: kind
    for kind in (
        Alignment,
        DampingMemory,
        GuardMemory,
        MITCommand,
        Memory,
        PolicyMemory,
        PolicyStep,
        RLPolicyMemory,
        RemoteMemory,
        SignMemory,
        StandbyMemory,
        StandbyState,
        SupervisorMemory,
    )
}


def start_document(memory: SupervisorMemory) -> str:
    """Return the memory as JSON. Raises `TypeError` where it holds something of a foreign controller."""
    return json.dumps(_plain(memory))


def start_memory(header: SessionHeader) -> SupervisorMemory | None:
    """Return the memory with which a recorded run began; None if with the control stack's own.

    Raises `InputError` if it is damaged.
    """
    text = header.documents.get(START_DOCUMENT)
    if text is None:
        return None
    with blaming(
        f"recording: its header's '{START_DOCUMENT}' is damaged",
        (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError),
    ):
        memory = _built(parse_json(text))
        if not isinstance(memory, SupervisorMemory):
            raise TypeError(f"is a {type(memory).__name__}")
        if memory.controller not in MODES:
            raise ValueError(known_names("controller", memory.controller, MODES))
    return memory


def _plain(value: Any) -> Any:
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, np.ndarray | np.generic):  # before float, which np.float64 is
        array = np.asarray(value)
        data = base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()
        kind = "array" if isinstance(value, np.ndarray) else "scalar"
        return {"type": kind, "dtype": array.dtype.str, "shape": list(array.shape), "data": data}
    if isinstance(value, float):
        return value if math.isfinite(value) else {"type": "float", "value": str(value)}
    name = type(value).__name__
    if is_dataclass(value) and _TYPES.get(name) is type(value):
        return {"type": name, **{field.name: _plain(getattr(value, field.name)) for field in fields(value)}}
    raise TypeError(f"memory holds a {name}, which a recording cannot keep")


def _built(document: Any) -> Any:
    if not isinstance(document, dict):
        return document
    values = dict(document)
    kind = values.pop("type")
    if kind == "float":
        return float(values["value"])
    if kind in ("array", "scalar"):
        dtype = np.dtype(values["dtype"])
        if dtype.kind not in "fiub":
            raise ValueError(f"dtype is {values['dtype']}")
        array = np.frombuffer(base64.b64decode(values["data"], validate=True), dtype).reshape(values["shape"])
        return array if kind == "array" else array[()]
    return _TYPES[kind](**{name: _built(value) for name, value in values.items()})
