"""The session header as MCAP metadata and attachments: at the front of the file, before the first tick."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping

from mcap.writer import Writer

from humanoid_sim.messages import SessionHeader
from humanoid_sim.ros2.mcap_writer import ChunkedWriter

SESSION = "humanoid_sim.session"
"""Metadata record with the header's own fields and a digest; the last part, so where it is the header is whole."""
DOCUMENTS = "humanoid_sim.documents"
"""Metadata record with the header's documents by name."""

_FORMAT = "2"
"""Changes when earlier readers would misread, or stumble over, a recording."""
_SHORTEST_PERIOD, _LONGEST_PERIOD = 1e-6, 1e3
"""s between two ticks of any robot."""


class HeaderError(ValueError):
    """A header that is damaged, or of another format."""


def write_header(writer: Writer | ChunkedWriter, header: SessionHeader) -> None:
    """Write the attachments, the documents and the fields, in this order."""
    for name, data in header.attachments.items():
        writer.add_attachment(header.start_time_ns, header.start_time_ns, name, "application/octet-stream", data)
    session, documents = header_metadata(header)
    writer.add_metadata(DOCUMENTS, documents)
    writer.add_metadata(SESSION, session)


def header_metadata(header: SessionHeader) -> tuple[dict[str, str], dict[str, str]]:
    """Return the fields and the documents of a header as `parse_header` takes them; the attachments go beside them."""
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
    """Return the header from its parts. Raises `HeaderError` if one is missing or damaged, or the format is unknown."""
    if session.get("format") != _FORMAT:
        raise HeaderError(f"header has format '{session.get('format')}', expected '{_FORMAT}'")
    fields = {key: value for key, value in session.items() if key != "digest"}
    if session.get("digest") != _digest(fields, documents):
        raise HeaderError("header is damaged (its digest is wrong)")
    try:
        missing = set(_texts(fields, "attachments")) - set(attachments)
        if missing:
            raise ValueError(f"attachment '{min(missing)}' is missing")
        return SessionHeader(
            robot=fields["robot"],
            joint_names=_joint_names(fields),
            control_period=_control_period(fields),
            start_time_ns=_start_time(fields),
            documents=dict(documents),
            attachments=dict(attachments),
            observation_terms=_observation_terms(fields),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise HeaderError(f"header is damaged ({error})") from None


def _texts(fields: Mapping[str, str], name: str) -> tuple[str, ...]:
    values = json.loads(fields[name])
    if not isinstance(values, list) or not all(isinstance(value, str) for value in values):
        raise ValueError(f"{name}: expected a list of texts")
    return tuple(values)


def _joint_names(fields: Mapping[str, str]) -> tuple[str, ...]:
    names = _texts(fields, "joint_names")
    if not names or len(set(names)) < len(names):
        raise ValueError("joint_names: expected at least one, each once")
    return names


def _control_period(fields: Mapping[str, str]) -> float:
    period = float(fields["control_period"])
    if not _SHORTEST_PERIOD <= period <= _LONGEST_PERIOD:  # written so that NaN fails it
        raise ValueError(f"control_period: is {period:g}, expected {_SHORTEST_PERIOD:g} to {_LONGEST_PERIOD:g} s")
    return period


def _start_time(fields: Mapping[str, str]) -> int:
    time_ns = int(fields["start_time_ns"])
    if abs(time_ns) >= 2**63:
        raise ValueError("start_time_ns: expected nanoseconds in 64 bits")
    return time_ns


def _observation_terms(fields: Mapping[str, str]) -> tuple[tuple[str, int], ...]:
    terms = tuple((name, width) for name, width in json.loads(fields["observation_terms"]))
    if not all(isinstance(name, str) and type(width) is int and width >= 0 for name, width in terms):
        raise ValueError("observation_terms: expected names and widths")
    return terms


def _digest(fields: Mapping[str, str], documents: Mapping[str, str]) -> str:
    """Metadata records have no checksum of their own."""
    return hashlib.sha256(json.dumps([fields, documents], sort_keys=True).encode()).hexdigest()
