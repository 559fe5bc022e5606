"""What an MJCF may ask for."""

import struct
import zlib

import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.robots.mjcf import compile_spec, describe_mjcf, read_spec
from humanoid_sim.robots.mjcf_bounds import check_mjcf_bounds

GEOM = '<geom type="sphere" size="0.1"/>'


def model(path, asset="", world=GEOM, before=""):
    (path / "m.xml").write_text(
        f"<mujoco>{before}<asset>{asset}</asset><worldbody>{world}</worldbody></mujoco>", encoding="utf-8"
    )
    return path / "m.xml"


def refusal(path):
    with pytest.raises(InputError) as caught:
        read_spec(path)
    return str(caught.value).removeprefix(f"{path}: ")


@pytest.mark.parametrize(
    ("parts", "problem"),
    [
        (
            {"asset": '<hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/>'},
            '<hfield nrow="100000" ncol="100000">: expected at most 16000000 values',
        ),
        (
            {"world": f'<replicate count="100000000">{GEOM}</replicate>'},
            '<replicate count="100000000"> makes more than 100000 elements',
        ),
        (
            {"world": f'<replicate count="1000"><replicate count="1000">{GEOM}</replicate></replicate>'},
            "has more than 100000 elements at <replicate>",
        ),
        (
            {"world": '<flexcomp name="f" type="grid" count="1000 1000 1000"/>'},
            '<flexcomp count="1000 1000 1000"> makes more than 100000 elements',
        ),
        (
            {"asset": '<texture name="t" type="2d" builtin="flat" width="1e6" height="1e6"/>'},
            '<texture width="1e6" height="1e6">: expected at most 16000000 values',
        ),
        ({"before": '<size memory="900G"/>'}, '<size memory="900G">: expected at most 1073741824 bytes'),
        ({"before": '<size nuserdata="999999999"/>'}, '<size nuserdata="999999999">: expected at most 16000000 values'),
        (
            {"before": '<custom><numeric name="n" size="nan"/></custom>'},
            '<numeric size="nan">: expected at most 16000000 values',
        ),
        ({"asset": '<mesh name="m" builtin="sphere" params="20"/>'}, '<mesh params="20">: expected at most 7'),
        ({"world": "<body>" * 300 + "</body>" * 300}, "is nested more than 200 levels deep"),
    ],
)
def test_a_size_beyond_any_robots_is_refused_before_memory_is_taken(tmp_path, parts, problem):
    assert refusal(model(tmp_path, **parts)) == problem


def test_included_files_count_too(tmp_path):
    (tmp_path / "more.xml").write_text(f'<mujoco><replicate count="1e9">{GEOM}</replicate></mujoco>', encoding="utf-8")
    path = model(tmp_path, world='<include file="more.xml"/>')
    assert refusal(path) == f'{tmp_path / "more.xml"}: <replicate count="1e9"> makes more than 100000 elements'
    (tmp_path / "more.xml").write_text('<mujoco><include file="m.xml"/></mujoco>', encoding="utf-8")
    check_mjcf_bounds(path)  # files that include each other: MuJoCo says so
    assert "already included" in refusal(path)


def _png(path, width, height):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    rows = zlib.compress(b"\0" * (1 + width) * min(height, 100))
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b""))
    return path


def _large(path, size):
    path.parent.mkdir(exist_ok=True)
    with path.open("wb") as file:
        file.truncate(size)  # a hole, which takes no room
    return path


@pytest.mark.parametrize(
    ("before", "asset", "named"),
    [
        ("", '<mesh name="m" file="big.obj"/>', "big.obj"),
        ('<compiler meshdir="parts"/>', '<mesh name="m" file="big.stl"/>', "parts/big.stl"),
        ('<compiler assetdir="parts" strippath="true"/>', '<mesh name="m" file="c:/x/big.msh"/>', "parts/big.msh"),
        ("", '<model name="kid" file="parts/kid.xml"/>', "parts/own/big.obj"),
    ],
)
def test_a_mesh_beyond_any_robots_is_refused_wherever_it_is(tmp_path, before, asset, named):
    (tmp_path / "parts").mkdir()
    kid = '<mujoco><compiler meshdir="own"/><asset><mesh name="m" file="big.obj"/></asset></mujoco>'
    (tmp_path / "parts" / "kid.xml").write_text(kid, encoding="utf-8")
    large = _large(tmp_path / named, 33_554_433)
    told = f"{large}: has 33554433 bytes, expected a mesh of at most 33554432"
    assert refusal(model(tmp_path, asset, before=before)) == told


def test_all_meshes_together_are_bounded(tmp_path):
    for i in range(17):
        _large(tmp_path / f"{i}.stl", 33_554_432)
    meshes = "".join(f'<mesh name="m{i}" file="{i}.stl"/>' for i in range(17))
    assert refusal(model(tmp_path, meshes)) == (
        "its meshes and pictures have 570425344 bytes, expected 536870912 at most"
    )


@pytest.mark.parametrize(
    "asset",
    [
        '<texture name="t" type="2d" file="p.png"/>',
        '<texture name="t" type="skybox" fileup="p.png"/>',
        '<hfield name="h" file="p.png" size="1 1 1 1"/>',
    ],
)
def test_a_picture_that_unpacks_to_more_than_any_is_refused(tmp_path, asset):
    picture = _png(tmp_path / "p.png", 20_000, 20_000)
    told = f"{picture}: has 20000 by 20000 pixels, expected a picture of at most 16000000"
    assert refusal(model(tmp_path, asset)) == told


def test_a_mesh_that_is_a_device_and_more_names_than_can_be_looked_for_are_refused(tmp_path):
    device = refusal(model(tmp_path, '<mesh name="m" file="/dev/zero"/>'))
    assert device.startswith("/dev/zero: is a pipe or a device, expected a mesh")
    folders = "".join(f'<compiler meshdir="d{i}"/>' for i in range(400))
    meshes = "".join(f'<mesh name="m{i}" file="{i}.stl"/>' for i in range(400))
    assert refusal(model(tmp_path, meshes, before=folders)) == "names 400 files in 400 folders, too many"


def test_usual_meshes_and_pictures_compile(tmp_path):
    _png(tmp_path / "p.png", 64, 64)
    (tmp_path / "tetrahedron.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n", encoding="utf-8"
    )
    asset = '<mesh name="m" file="tetrahedron.obj"/><texture name="t" type="2d" file="p.png"/>'
    path = model(tmp_path, asset, '<geom type="mesh" mesh="m"/>')
    assert compile_spec(read_spec(path), path).mesh_vertnum.tolist() == [4]
    hfield = '<hfield name="h" nrow="1000" ncol="1000" size="1 1 1 1"/>'
    check_mjcf_bounds(model(tmp_path, asset=hfield, world=f'<replicate count="100">{GEOM}</replicate>'))


@pytest.mark.parametrize("value", ["nan", "1e300", "inf"])
def test_a_place_that_is_no_number_is_refused_and_nothing_is_printed_or_left(tmp_path, value, capfd, monkeypatch):
    """MuJoCo itself warns of NaN on stderr, in a file MUJOCO_LOG.TXT, and lets it pass."""
    monkeypatch.chdir(tmp_path)
    path = model(tmp_path, world=f'<body name="arm" pos="{value} 0 0"><joint name="j"/>{GEOM}</body>')
    with pytest.raises(InputError) as caught:
        describe_mjcf(path)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")
    assert [file.name for file in tmp_path.iterdir()] == ["m.xml"]
