"""The session header as MCAP metadata and attachments: at the front of the file, before the first tick."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

from mcap.writer import Writer

from humanoid_sim.errors import InputError, blaming
from humanoid_sim.messages import SessionHeader

SESSION = "humanoid_sim.session"
"""Metadata record with the header's own fields; the last part, so where it is the header is whole."""
DOCUMENTS = "humanoid_sim.documents"
"""Metadata record with the header's documents by name."""
LABELS_DOCUMENT = "labels"
"""Document with the names of the values of each `observation` term and of the `action`."""
_FORMAT = "2"


def write_header(writer: Writer, header: SessionHeader) -> None:
    """Write the attachments, the documents and the fields, in this order."""
    for name, data in header.attachments.items():
        writer.add_attachment(header.start_time_ns, header.start_time_ns, name, "application/octet-stream", data)
    writer.add_metadata(DOCUMENTS, dict(header.documents))
    writer.add_metadata(SESSION, header_fields(header))


def header_fields(header: SessionHeader) -> dict[str, str]:
    """Return the header's own fields as `parse_header` takes them."""
    return {
        "format": _FORMAT,
        "robot": header.robot,
        "joint_names": json.dumps(header.joint_names),
        "control_period": repr(float(header.control_period)),
        "start_time_ns": str(header.start_time_ns),
        "observation_terms": json.dumps(header.observation_terms),
        "attachments": json.dumps(list(header.attachments)),
    }


def parse_header(
    where: str, fields: Mapping[str, str], documents: Mapping[str, str], attachments: Mapping[str, bytes]
) -> SessionHeader:
    """Return a header. Raises `InputError`, which `where` begins, if it is damaged or of another format."""
    if fields.get("format") != _FORMAT:
        raise InputError(f"{where}: header has format '{fields.get('format')}', expected '{_FORMAT}'")
    with blaming(f"{where}: header is damaged", (KeyError, TypeError, ValueError)):
        period, start = float(fields["control_period"]), int(fields["start_time_ns"])
        if not 0.0 < period < math.inf or not 0 <= start < 2**63:
            raise ValueError(f"control_period is {period:g}, start_time_ns {start}")
        return SessionHeader(
            robot=fields["robot"],
            joint_names=tuple(json.loads(fields["joint_names"])),
            control_period=period,
            start_time_ns=start,
            documents=dict(documents),
            attachments={name: attachments[name] for name in json.loads(fields["attachments"])},
            observation_terms=tuple((name, width) for name, width in json.loads(fields["observation_terms"])),
        )


def json_document(header: SessionHeader, name: str) -> dict[str, Any]:
    """Return a JSON object among a header's documents; empty where there is none. Raises `InputError` if damaged."""
    with blaming(f"recording: header's document '{name}' is damaged", (ValueError, TypeError)):
        document: dict[str, Any] = dict(**json.loads(header.documents.get(name, "{}")))
    return document
