"""Names of the policy's values in a recording's header."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field

from humanoid_sim.messages import SessionHeader
from humanoid_sim.strict_json import parse_json

LABELS_DOCUMENT = "labels"


@dataclass(frozen=True, slots=True)
class Labels:
    """Names of the values of each observation term and of the action; without any where the header has none."""

    observation: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    action: tuple[str, ...] = ()


def labels_document(observation: Mapping[str, tuple[str, ...]], action: tuple[str, ...]) -> str:
    """Return the names as a document of a header."""
    return json.dumps({"observation": observation, "action": action})


def read_labels(header: SessionHeader) -> Labels:
    """Return the names in a header; names that are damaged or missing are none: plots go without."""
    try:
        document = parse_json(header.documents.get(LABELS_DOCUMENT, "{}"))
        observation = {str(term): _texts(names) for term, names in document.get("observation", {}).items()}
        return Labels(observation, _texts(document.get("action", [])))
    except (ValueError, TypeError, AttributeError):
        return Labels()


def _texts(values: object) -> tuple[str, ...]:
    if not isinstance(values, list):
        raise TypeError
    return tuple(str(value) for value in values)
