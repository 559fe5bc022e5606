"""The session header as MCAP metadata and attachments: at the front of the file, before the first tick."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from mcap.writer import Writer

from humanoid_sim.errors import InputError
from humanoid_sim.messages import SessionHeader

SESSION = "humanoid_sim.session"
"""Metadata record with the header's own fields; the last part, so where it is the header is whole."""
DOCUMENTS = "humanoid_sim.documents"
"""Metadata record with the header's documents by name."""
_FORMAT = "2"


class HeaderError(ValueError):
    """A header that is damaged, or of another format."""


def write_header(writer: Writer, header: SessionHeader) -> None:
    """Write the attachments, the documents and the fields, in this order."""
    for name, data in header.attachments.items():
        writer.add_attachment(header.start_time_ns, header.start_time_ns, name, "application/octet-stream", data)
    session, documents = header_metadata(header)
    writer.add_metadata(DOCUMENTS, documents)
    writer.add_metadata(SESSION, session)


def header_metadata(header: SessionHeader) -> tuple[dict[str, str], dict[str, str]]:
    """Return the fields and the documents of a header as `parse_header` takes them; the attachments go beside them."""
    session = {
        "format": _FORMAT,
        "robot": header.robot,
        "joint_names": json.dumps(header.joint_names),
        "control_period": repr(float(header.control_period)),
        "start_time_ns": str(header.start_time_ns),
        "observation_terms": json.dumps(header.observation_terms),
        "attachments": json.dumps(list(header.attachments)),
    }
    return session, dict(header.documents)


def parse_header(
    session: Mapping[str, str], documents: Mapping[str, str], attachments: Mapping[str, bytes]
) -> SessionHeader:
    """Return the header from its parts. Raises `HeaderError` if one is missing or damaged, or the format is unknown."""
    if session.get("format") != _FORMAT:
        raise HeaderError(f"header has format '{session.get('format')}', expected '{_FORMAT}'")
    try:
        return SessionHeader(
            robot=session["robot"],
            joint_names=tuple(json.loads(session["joint_names"])),
            control_period=float(session["control_period"]),
            start_time_ns=int(session["start_time_ns"]),
            documents=dict(documents),
            attachments={name: attachments[name] for name in json.loads(session["attachments"])},
            observation_terms=tuple(
                (str(name), int(width)) for name, width in json.loads(session["observation_terms"])
            ),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise HeaderError(f"header is damaged ({error})") from None


def json_document(header: SessionHeader, name: str) -> dict[str, Any]:
    """Return a JSON object among a header's documents; empty where there is none. Raises `InputError` if damaged."""
    try:
        document = json.loads(header.documents.get(name, "{}"))
    except ValueError as error:
        raise InputError(f"recording: its header's '{name}' is no JSON: {error}") from None
    if not isinstance(document, dict):
        raise InputError(f"recording: its header's '{name}' is a {type(document).__name__}, expected a JSON object")
    return document
