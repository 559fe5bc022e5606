"""The session header as MCAP metadata and attachments: at the front of the file, before the first tick."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping

from mcap.writer import Writer

from humanoid_sim.messages import SessionHeader

__all__ = ["DOCUMENTS", "EARLIER_FORMAT", "SESSION", "HeaderError", "header_metadata", "parse_header", "write_header"]

SESSION = "humanoid_sim.session"
"""Metadata record with the header's own fields and a digest; the last part, so where it is the header is whole."""
DOCUMENTS = "humanoid_sim.documents"
"""Metadata record with the header's documents by name."""

_FORMAT = "2"
"""Changes when earlier readers would misread, or stumble over, a recording."""
EARLIER_FORMAT = "1"
"""Of recordings whose events have no kind, and whose ticks do not say what the policy raised; see `earlier`."""


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
    """The fields and the documents of a header as `parse_header` takes them; the attachments go beside them."""
    documents = dict(header.documents)
    session = {
        "format": _FORMAT,
        "robot": header.robot,
        "joint_names": json.dumps(header.joint_names),
        "control_period": repr(float(header.control_period)),
        "start_time_ns": str(header.start_time_ns),
        "observation_terms": json.dumps(header.observation_terms),
        "attachments": json.dumps(list(header.attachments)),
    }
    return session | {"digest": _digest(session, documents)}, documents


def parse_header(
    session: Mapping[str, str], documents: Mapping[str, str], attachments: Mapping[str, bytes]
) -> SessionHeader:
    """The header from its parts.

    Raises:
        HeaderError: if a part is missing or damaged, or the format is unknown.
    """
    if session.get("format") not in (EARLIER_FORMAT, _FORMAT):
        raise HeaderError(f"header has format '{session.get('format')}', expected '{EARLIER_FORMAT}' or '{_FORMAT}'")
    fields = {key: value for key, value in session.items() if key != "digest"}
    if session.get("digest") != _digest(fields, documents):
        raise HeaderError("header is damaged (its digest is wrong)")
    try:
        missing = set(json.loads(fields["attachments"])) - set(attachments)
        if missing:
            raise HeaderError(f"header is damaged (attachment '{min(missing)}' is missing)")
        return SessionHeader(
            robot=fields["robot"],
            joint_names=tuple(json.loads(fields["joint_names"])),
            control_period=float(fields["control_period"]),
            start_time_ns=int(fields["start_time_ns"]),
            documents=dict(documents),
            attachments=dict(attachments),
            observation_terms=tuple((name, width) for name, width in json.loads(fields["observation_terms"])),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise HeaderError(f"header is damaged ({error})") from None


def _digest(fields: Mapping[str, str], documents: Mapping[str, str]) -> str:
    """Metadata records have no checksum of their own."""
    return hashlib.sha256(json.dumps([fields, documents], sort_keys=True).encode()).hexdigest()
