"""Mutations of formats with checksums and structure: what a writer could have written, with something odd in it."""

import io
import json
import struct
import zipfile
from collections.abc import Callable, Mapping
from io import BytesIO
from typing import Any
from xml.etree import ElementTree

import numpy as np
from mcap.records import Attachment, Channel, Header, Metadata, Schema
from mcap.writer import CompressionType, Writer
from mutate import mutated_bytes, mutated_document, odd, written

from humanoid_sim.recording import header as header_module
from humanoid_sim.ros2.mcap_stream import McapStream, Message

__all__ = ["mutated_json", "mutated_mcap", "mutated_npz", "mutated_onnx", "mutated_xml", "shortened"]

_HOSTILE = ("[" * 100_000, "{", "\udcff", "", "0", "-1", "1e400", "null", '{"version": 1}', "NaN", "9" * 5000)
"""Texts where another format is expected inside a record."""


def _pick(items: Any, rng: np.random.Generator) -> Any:
    return items[int(rng.integers(len(items)))]


def mutated_json(text: str, rng: np.random.Generator) -> str:
    """A text that holds JSON, or a CSV line, changed."""
    if rng.random() < 0.15:
        return str(_pick(_HOSTILE, rng))
    try:
        document = json.loads(text)
    except ValueError:
        document = None
    if isinstance(document, dict | list) and document and rng.random() < 0.8:
        return json.dumps(mutated_document(document, rng), allow_nan=True)
    if "," in text and rng.random() < 0.7:
        cells = text.split(",")
        cells[int(rng.integers(len(cells)))] = str(odd(rng))
        return ",".join(cells)
    return mutated_bytes(text.encode("utf-8", "surrogatepass"), rng).decode("utf-8", "replace")


def mutated_mcap(data: bytes, rng: np.random.Generator) -> bytes:
    """The records of an MCAP file with one or two of them changed, under checksums that are right."""
    records = list(McapStream(BytesIO(data)))
    for _ in range(int(rng.integers(1, 3))):
        rare = [i for i, record in enumerate(records) if not isinstance(record, Message)]
        i = _pick(rare, rng) if rng.random() < 0.6 else int(rng.integers(len(records)))
        match int(rng.integers(8)):
            case 0:
                del records[i]
            case 1:
                records.insert(int(rng.integers(len(records))), records[i])
            case 2 if isinstance(records[i], Attachment):
                records[i].data = data  # a file in itself
            case _:
                records[i] = _changed_record(records[i], rng)
        if not records:
            break
    if rng.random() < 0.9:
        _sign(records)
    return _written(records)


def _sign(records: list[Any]) -> None:
    """Give a recording's header the digest that it has to have."""
    named = {record.name: record.metadata for record in records if isinstance(record, Metadata)}
    session, documents = named.get(header_module.SESSION), named.get(header_module.DOCUMENTS)
    if session is not None and documents is not None:
        fields = {key: value for key, value in session.items() if key != "digest"}
        session["digest"] = header_module._digest(fields, documents)


def _changed_record(record: Any, rng: np.random.Generator) -> Any:
    if isinstance(record, Message):
        choice = int(rng.integers(4))
        if choice == 0:
            return record._replace(log_time=int(rng.choice([0, 1, 2**63 - 1])))
        if choice == 1:
            return record._replace(channel_id=int(rng.choice([0, 1, 2, 999])))
        return record._replace(data=mutated_bytes(record.data, rng))
    if isinstance(record, Metadata) and record.metadata:
        key = _pick(sorted(record.metadata), rng)
        if rng.random() < 0.15:
            del record.metadata[key]
        else:
            record.metadata[key] = mutated_json(record.metadata[key], rng)
    elif isinstance(record, Attachment):
        record.data = mutated_mcap(record.data, rng) if rng.random() < 0.5 else mutated_bytes(record.data, rng)
    elif isinstance(record, Schema):
        record.name = _pick((record.name, "", "std_msgs/msg/String"), rng)
        record.data = mutated_bytes(record.data, rng)
    elif isinstance(record, Channel):
        record.topic = _pick((record.topic, "", "/humanoid_sim/tick", "/humanoid_sim/event", "/motion"), rng)
        record.message_encoding = _pick((record.message_encoding, "json"), rng)
        record.schema_id = _pick((record.schema_id, 0, 77), rng)
    return record


def _written(records: list[Any]) -> bytes:
    stream = BytesIO()
    writer = Writer(stream, compression=CompressionType.LZ4)
    schemas: dict[int, int] = {0: 0}
    channels: dict[int, int] = {}
    writer.start()
    try:
        for record in records:
            if isinstance(record, Header):
                continue
            if isinstance(record, Schema):
                schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
            elif isinstance(record, Channel):
                schema = schemas.get(record.schema_id, record.schema_id)
                channels[record.id] = writer.register_channel(record.topic, record.message_encoding, schema)
            elif isinstance(record, Message):
                channel = channels.get(record.channel_id, record.channel_id)
                writer.add_message(channel, record.log_time, record.data, record.publish_time, record.sequence)
            elif isinstance(record, Attachment):
                writer.add_attachment(record.create_time, record.log_time, record.name, record.media_type, record.data)
            elif isinstance(record, Metadata):
                writer.add_metadata(record.name, record.metadata)
        writer.finish()
    except (struct.error, KeyError, UnicodeEncodeError):  # a record that no writer can write: the file ends there
        pass
    return stream.getvalue()


def shortened(data: bytes, messages: int, skip: int = 0) -> bytes:
    """An MCAP file with some of its messages, so that a mutant is read quickly."""
    records, taken, seen = [], 0, 0
    for record in McapStream(BytesIO(data)):
        if isinstance(record, Message):
            seen += 1
            if seen <= skip or taken >= messages:
                continue
            taken += 1
        records.append(record)
    return _written(records)


def mutated_npz(data: bytes, rng: np.random.Generator) -> bytes:
    """The arrays of an archive, one or two of them with another type, shape or header, or none of their own bytes."""
    with np.load(BytesIO(data)) as archive:
        arrays = {name: archive[name] for name in archive.files}
    members = {f"{name}.npy": _npy(array) for name, array in arrays.items()}
    for _ in range(int(rng.integers(1, 3))):
        name = _pick(sorted(arrays), rng)
        members[f"{name}.npy"] = _changed_array(arrays[name], rng)
        if rng.random() < 0.1:
            del members[f"{name}.npy"]
    stream = BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED if rng.random() < 0.3 else zipfile.ZIP_STORED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return stream.getvalue()


def _npy(array: np.ndarray) -> bytes:
    stream = BytesIO()
    np.save(stream, array, allow_pickle=True)
    return stream.getvalue()


def _changed_array(array: np.ndarray, rng: np.random.Generator) -> bytes:  # noqa: PLR0911 - one per mutation
    shapes = ((1 << 40,), (1 << 33, 1 << 31), (0,), (), (10**8, 3), (2,) * 40, (-1, 3), (1 << 62, 4))
    descriptions = ("<f8", "|O", "<U100000000", "<c16", "|b1", "<M8[s]", "x", "(1000000,)<f8", "<f2")
    match int(rng.integers(8)):
        case 0:
            return _claimed("<f8", _pick(shapes, rng), array.tobytes())
        case 1:
            return _claimed(_pick(descriptions, rng), array.shape, array.tobytes())
        case 2:
            thing = np.empty(1, dtype=object)
            thing[0] = {"x": [None, "y"]}
            return _npy(thing)
        case 3:
            return _npy(np.zeros(array.shape, dtype=_pick(("f2", "i1", "c16", "U8", "?", "u8"), rng)))
        case 4:
            return _npy(array.reshape(-1)[: int(rng.integers(0, 5))])
        case 5:
            changed = np.array(array, dtype=np.float64) if array.dtype.kind in "fiu" else np.array(array)
            if changed.size and changed.dtype.kind == "f":
                changed.reshape(-1)[int(rng.integers(changed.size))] = _pick((np.nan, np.inf, 1e308, 1e-320, -1), rng)
            return _npy(changed)
        case 6:
            return _npy(np.broadcast_to(array, (2, *array.shape)))
        case _:
            return mutated_bytes(_npy(array), rng)


def _claimed(description: str, shape: tuple[int, ...], content: bytes) -> bytes:
    header = f"{{'descr': {description!r}, 'fortran_order': False, 'shape': {shape!r}, }}"
    text = header.encode() + b" " * (-(len(header) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + content


def mutated_onnx(data: bytes, rng: np.random.Generator) -> bytes:  # noqa: PLR0912 - one per mutation
    """A model with another metadata text, size, tensor, node or version."""
    import onnx  # noqa: PLC0415

    model = onnx.load_from_string(data)
    graph = model.graph
    for _ in range(int(rng.integers(1, 3))):
        match int(rng.integers(10)):
            case 0 | 1 | 2 | 3 if model.metadata_props:
                entry = _pick(model.metadata_props, rng)
                entry.value = mutated_json(entry.value, rng).encode("utf-8", "replace").decode()
                if rng.random() < 0.1:
                    model.metadata_props.remove(entry)
            case 4:
                values = [*graph.input, *graph.output]
                dims = _pick(values, rng).type.tensor_type.shape.dim
                if dims:
                    _pick(dims, rng).dim_value = _pick((0, 1, -1, 10**6, 10**10, 2**62), rng)
            case 5 if graph.initializer:
                tensor = _pick(graph.initializer, rng)
                if tensor.dims:
                    tensor.dims[int(rng.integers(len(tensor.dims)))] = _pick((0, -1, 3, 10**10, 2**62), rng)
            case 6 if graph.node:
                del graph.node[int(rng.integers(len(graph.node)))]
            case 7 if graph.node:
                _pick(graph.node, rng).op_type = _pick(("Relu", "NoSuch", "Softmax", "ConstantOfShape", "Tile"), rng)
            case 8:
                model.opset_import[0].version = _pick((0, 1, 99, 2**40), rng)
            case _:
                _pick([*graph.input, *graph.output], rng).name = _pick(("x", "", "time_step", "actions"), rng)
    try:
        content = model.SerializeToString()
    except Exception:  # what protobuf cannot write nobody can have written
        content = data
    if rng.random() < 0.1:
        content = content.replace(b"joint", b"\xff\xfe\xc0nt", int(rng.integers(1, 4)))
    return content


def mutated_xml(data: bytes, rng: np.random.Generator) -> bytes:
    """An element with another attribute, doubled, moved, left out or nested."""
    root = ElementTree.fromstring(data)
    for _ in range(int(rng.integers(1, 3))):
        parents = [element for element in root.iter() if len(element)]
        parent = _pick(parents, rng)
        child = parent[int(rng.integers(len(parent)))]
        match int(rng.integers(7)):
            case 0:
                parent.remove(child)
            case 1:
                parent.append(child)
            case 2:
                other = _pick(parents, rng)
                if other is not child and child not in other.iter() and other not in child.iter():
                    other.append(child)
            case 3:
                wrapped = child
                for _ in range(int(_pick((2, 50, 3000), rng))):
                    outer = ElementTree.Element(_pick(("body", "replicate", "frame"), rng))
                    outer.append(wrapped)
                    wrapped = outer
                parent.append(wrapped)
            case _:
                elements = [element for element in root.iter() if element.attrib]
                element = _pick(elements, rng)
                key = _pick(sorted(element.attrib), rng)
                numbers = ("0", "-1", "1e308", "nan", "inf", "100000000", "99999999999", "1 2", "1e-320", "", "x")
                words = element.attrib[key].split() or ["0"]
                words[int(rng.integers(len(words)))] = _pick(numbers, rng)
                element.attrib[key] = " ".join(words)
    stream = io.BytesIO()
    try:
        ElementTree.ElementTree(root).write(stream)
    except RecursionError:
        return b"<mujoco>" + b"<body>" * 5000
    return stream.getvalue()


Structured = Callable[[bytes, np.random.Generator], bytes]
STRUCTURED: Mapping[str, Structured] = {
    "mcap": mutated_mcap,
    "npz": mutated_npz,
    "onnx": mutated_onnx,
    "xml": mutated_xml,
}
"""By a file's format the mutation that knows it; YAML and JSON are trees."""


def mutant(data: bytes, kind: str, rng: np.random.Generator, document: Any = None) -> bytes:
    """One mutant of a file, by its format's mutation or byte by byte."""
    if kind in STRUCTURED and rng.random() < 0.7:
        return STRUCTURED[kind](data, rng)
    if document is not None and rng.random() < 0.7:
        return written(mutated_document(document, rng), rng)
    return mutated_bytes(data, rng)
