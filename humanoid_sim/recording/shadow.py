"""Messages of a shadow policy in a recording: what it saw, what it answered, and the command it would have given.

A shadow policy runs along with a robot that something else drives; nothing of it reaches a motor or appears in a tick.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from humanoid_sim.errors import blaming
from humanoid_sim.messages import PolicyStep, SessionHeader
from humanoid_sim.mit import COMMAND_FIELDS, MITCommand
from humanoid_sim.policy.contract_json import encode
from humanoid_sim.policy.describe import observation_labels
from humanoid_sim.policy.loaded_policy import LoadedPolicy
from humanoid_sim.recording.reader import messages_of
from humanoid_sim.recording.topics import Labels, PolicyTopics, TopicMessage
from humanoid_sim.ros2.cdr import CdrError, CdrReader, CdrWriter
from humanoid_sim.ros2.definitions import MIT_COMMAND, SHADOW_STEP
from humanoid_sim.ros2.messages import encode_mit_command
from humanoid_sim.strict_json import parse_json

SHADOW_DOCUMENT = "shadow"
"""Document of a header: the shadow policy's file and the terms of its observation."""
SHADOW_CONTRACT_DOCUMENT = "shadow_contract"
_PREFIX = "/humanoid_sim/shadow"
SHADOW_TOPIC = f"{_PREFIX}/step"
_MOST = 4096
"""Values of an answer that are kept: one that is too long is a fault, and its beginning shows why."""


@dataclass(frozen=True, slots=True, eq=False)
class ShadowStep:
    """One inference of a shadow policy, or why there was none."""

    tick: int
    """Index of the tick whose state it saw."""
    time: float
    """s, the robot's clock, of that state."""
    step: PolicyStep | None = None
    """Observation and answer of the inference; None if there was none."""
    command: MITCommand | None = None
    """Command that it would have given; None with a fault."""
    fault: str = ""
    """Reason for a missing command; empty if there is one."""


def encode_shadow_step(shadow: ShadowStep) -> bytes:
    """`humanoid_sim_msgs/msg/ShadowStep`."""
    nothing, none = np.zeros(0, dtype=np.float32), np.zeros(0)
    step = shadow.step
    writer = CdrWriter()
    writer.pack("Qdq", shadow.tick, shadow.time, -1 if step is None else step.frame)
    writer.array(nothing if step is None else step.observation)
    writer.array(nothing if step is None else step.action.reshape(-1)[:_MOST])
    for name in COMMAND_FIELDS:
        writer.array(none if shadow.command is None else getattr(shadow.command, name))
    writer.string(shadow.fault)
    return writer.message()


def decode_shadow_step(message: bytes) -> ShadowStep:
    """Return the step in a message. Raises `CdrError`."""
    reader = CdrReader(message)
    tick, time, frame = reader.unpack("Qdq")
    observation, action = reader.array(np.float32), reader.array(np.float32)
    arrays = [reader.array(np.float64) for _ in COMMAND_FIELDS]
    fault = reader.string()
    reader.finish()
    if len({len(values) for values in arrays}) > 1:
        raise CdrError("a command whose arrays differ in length")
    return ShadowStep(
        tick,
        time,
        PolicyStep(frame, observation, action) if len(observation) else None,
        MITCommand(*arrays) if len(arrays[0]) else None,
        fault,
    )


def shadow_documents(source: str, sha256: str, motion: str | None, loaded: LoadedPolicy) -> dict[str, str]:
    """Return what a header says of a shadow policy."""
    contract, layout = loaded.contract, loaded.layout
    told = {
        "policy": source,
        "policy_sha256": sha256,
        "motion": motion,
        "observation_terms": [[term.name, term.width] for term in layout.terms],
        "observation": observation_labels(contract, layout),
        "action": contract.action_joint_names,
    }
    return {SHADOW_DOCUMENT: json.dumps(told, indent=1), SHADOW_CONTRACT_DOCUMENT: encode(loaded.contract)}


def shadow_values(header: SessionHeader) -> tuple[tuple[tuple[str, int], ...], Labels] | None:
    """Name and width of each term that the shadow policy of a run observes, and the names of their values.

    None without a shadow policy, and of a header that is damaged there: plots go without.
    """
    if SHADOW_DOCUMENT not in header.documents:
        return None
    try:
        told = parse_json(header.documents[SHADOW_DOCUMENT])
        terms = tuple((str(name), range(width).stop) for name, width in told["observation_terms"])
        observation = {str(term): tuple(map(str, names)) for term, names in told["observation"].items()}
        return terms, Labels(observation, tuple(map(str, told["action"])))
    except (ValueError, TypeError, KeyError, AttributeError):
        return None


def shadow_width(loaded: LoadedPolicy) -> int:
    """Return how many values it observes and answers."""
    return loaded.layout.width + len(loaded.contract.action_joint_names)


class ShadowTopics:
    """Turns the steps of one shadow policy into messages: one that holds everything, and those that viewers plot."""

    def __init__(self, header: SessionHeader) -> None:
        """Prepare for a run whose header has a shadow policy."""
        self._joints = header.joint_names
        self._start_time_ns = header.start_time_ns
        self._policy = PolicyTopics(_PREFIX, *(shadow_values(header) or ((), Labels())))

    def messages(self, shadow: ShadowStep, encoded: bytes) -> Iterator[TopicMessage]:
        """Yield the messages of a step; `encoded` is the step's own."""
        yield TopicMessage(SHADOW_TOPIC, SHADOW_STEP, encoded)
        if not math.isfinite(shadow.time) or abs(shadow.time) >= 1e9:
            return
        time_ns = max(0, self._start_time_ns + round(shadow.time * 1e9))
        if shadow.command is not None:
            data = encode_mit_command(time_ns, self._joints, shadow.command)
            yield TopicMessage(f"{_PREFIX}/mit_command", MIT_COMMAND, data)
        if shadow.step is not None:
            yield from self._policy.messages(shadow.step, time_ns)


def read_shadow_steps(path: str | Path) -> Iterator[ShadowStep]:
    """Yield the steps of the shadow policy in a recording, in their order; none where none ran.

    Raises `InputError` if the file cannot be read, or a message is damaged.
    """
    for data in messages_of(path, SHADOW_TOPIC):
        with blaming(f"{path}: a message of {SHADOW_TOPIC}", (CdrError, ValueError)):
            yield decode_shadow_step(data)
