"""Whatever a source holds: a contract, or one line of an `InputError`, and nothing else."""

import json
from collections.abc import Mapping

import dialects
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.errors import InputError
from humanoid_sim.policy.contract_json import STAMP_KEY, encode
from humanoid_sim.policy.metadata import write_metadata
from humanoid_sim.policy.readers.contract_yaml import read_contract_file
from humanoid_sim.policy.readers.merge import merge
from humanoid_sim.policy.readers.sources import metadata_contract
from humanoid_sim.policy.readers.unitree import read_deploy

scalars = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.sampled_from(["a", "b"])
anything = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3)
)


def contract_or_one_line(read):
    message = ""
    try:
        merge(read(), "policy.onnx", dialects.ROBOT)
    except InputError as error:
        message = str(error)
    assert "\n" not in message
    assert len(message) < 2000


@st.composite
def broken(draw, document):
    """The document with one of its values replaced by something else, or left out."""
    paths = list(_paths(document))
    path = draw(st.sampled_from(paths))
    value = draw(anything)
    leave_out = draw(st.booleans())
    return _replaced(document, path, value, leave_out)


def _paths(document, prefix=()):
    items = document.items() if isinstance(document, Mapping) else enumerate(document)
    for key, value in items:
        yield (*prefix, key)
        if isinstance(value, dict | list) and value:
            yield from _paths(value, (*prefix, key))


def _replaced(document, path, value, leave_out):
    copy = dict(document) if isinstance(document, Mapping) else list(document)
    if len(path) > 1:
        copy[path[0]] = _replaced(copy[path[0]], path[1:], value, leave_out)
    elif leave_out:
        del copy[path[0]]
    else:
        copy[path[0]] = value
    return copy


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("broken")


WALKER = dialects.a_walker()
DEPLOY = dialects.as_deploy(WALKER)
CONTRACT = dialects.as_contract_yaml(WALKER)
STAMP = json.loads(encode(WALKER))


@given(broken(DEPLOY))
def test_deploy_yaml(folder, document):
    path = folder / "deploy.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    contract_or_one_line(lambda: [read_deploy(path)])


@given(broken(CONTRACT) | broken({"override": CONTRACT}))
def test_contract_yaml(folder, document):
    path = folder / "contract.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    contract_or_one_line(lambda: read_contract_file(path))


@pytest.mark.parametrize("read", [read_contract_file, lambda path: [read_deploy(path)]])
@given(
    content=st.binary(max_size=60) | st.text(max_size=60).map(str.encode) | anything.map(yaml.safe_dump).map(str.encode)
)
def test_any_file(folder, read, content):
    path = folder / "any.yaml"
    path.write_bytes(content)
    contract_or_one_line(lambda: read(path))


@given(broken(STAMP))
def test_stamps(document):
    contract_or_one_line(lambda: metadata_contract({STAMP_KEY: json.dumps(document)}, "policy.onnx"))


texts = st.text(max_size=20) | st.sampled_from(["", "1,2", "nan", "1;2,3", "[1, 2", "[]", "{}", '"x"', "null", "1e999"])
METADATA = {"own": write_metadata(WALKER), "mjlab": dialects.as_mjlab(WALKER), "holosoma": dialects.as_holosoma(WALKER)}


@pytest.mark.parametrize("dialect", METADATA)
@given(data=st.data())
def test_metadata(dialect, data):
    metadata = dict(METADATA[dialect])
    for key in data.draw(st.lists(st.sampled_from(sorted(metadata)), min_size=1, max_size=3, unique=True)):
        if data.draw(st.booleans()):
            metadata[key] = data.draw(texts | anything.map(str) | anything.map(json.dumps))
        else:
            del metadata[key]
    contract_or_one_line(lambda: metadata_contract(metadata, "policy.onnx"))


def test_deep_nesting_is_no_crash(folder):
    path = folder / "deep.yaml"
    path.write_text("[" * 5000)
    contract_or_one_line(lambda: read_contract_file(path))
    contract_or_one_line(lambda: metadata_contract({"dof_names": "[" * 100_000}, "policy.onnx"))
    contract_or_one_line(lambda: metadata_contract({STAMP_KEY: "[" * 100_000}, "policy.onnx"))
