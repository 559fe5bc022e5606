"""From DDS to the intake: live inputs that the policy observes, each from the topic that its contract names."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from humanoid_sim.client import Intake
from humanoid_sim.controllers.contract import live_topic
from humanoid_sim.frontends.attach import Attachment
from humanoid_sim.ros2.cdr import CdrError
from humanoid_sim.ros2.dds.domain import Participant
from humanoid_sim.ros2.dds.endpoints import Reader, Received
from humanoid_sim.ros2.messages import decode_float32_array
from humanoid_sim.ros2.topics import LIVE_INPUT


class Wanted(NamedTuple):
    """A live input that the session takes from outside."""

    topic: str
    width: int
    latched: bool
    """True where a value counts until the next one, so that one from before the bridge does too."""


def wanted_inputs(attachment: Attachment) -> dict[str, Wanted]:
    """Return the live inputs that a session takes from outside, by name."""
    topics = {name: live_topic(attachment.contract, name) for name in attachment.feed.live_inputs}
    return {
        name: Wanted(topic.name, attachment.feed.live_inputs[name], topic.timeout == math.inf)
        for name, topic in topics.items()
        if topic is not None
    }


class LiveForwarder:
    """Hands values on as they arrive. For one thread."""

    def __init__(self, participant: Participant, intake: Intake, refuse: Callable[[str, str], None]) -> None:
        """Subscribe to nothing yet; `refuse` counts a message that is not accepted, by its topic and the reason."""
        self._participant, self._intake, self._refuse = participant, intake, refuse
        self._readers: dict[str, tuple[Wanted, Sequence[Reader]]] = {}

    def follow(self, wanted: Mapping[str, Wanted]) -> None:
        """Subscribe to what the session takes, and to nothing else."""
        kept = {name: found for name, found in self._readers.items() if wanted.get(name) == found[0]}
        self._readers = {name: kept.get(name) or (one, self._subscribed(one)) for name, one in wanted.items()}

    def take(self, stamp: Callable[[Received], int]) -> None:
        """Hand on the newest value of each; `stamp` gives a sample's arrival, ns."""
        for name, (wanted, readers) in self._readers.items():
            for sample in [one for reader in readers for one in reader.take()[-1:]]:
                try:
                    values = decode_float32_array(sample.data)
                except CdrError as error:
                    self._refuse(wanted.topic, str(error))
                    continue
                if len(values) != wanted.width:
                    problem = f"has {len(values)} values, expected {wanted.width} for the live input '{name}'"
                    self._refuse(wanted.topic, problem)
                    continue
                self._intake.live(name, values.tolist(), stamp=stamp(sample))

    def _subscribed(self, wanted: Wanted) -> Sequence[Reader]:
        """Subscribe reliably, and to writers of any other quality of service as well."""
        kind = LIVE_INPUT._replace(latched=wanted.latched)
        return [Reader(self._participant, wanted.topic, kind, any_writer=any_writer) for any_writer in (True, False)]
