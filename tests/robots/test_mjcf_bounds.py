"""What an MJCF may ask for."""

from __future__ import annotations

from pathlib import Path

import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.robots.mjcf import describe_mjcf, read_spec
from humanoid_sim.robots.mjcf_bounds import check_mjcf_bounds

GEOM = '<geom type="sphere" size="0.1"/>'


def model(path: Path, asset: str = "", world: str = GEOM, before: str = "") -> Path:
    (path / "m.xml").write_text(
        f"<mujoco>{before}<asset>{asset}</asset><worldbody>{world}</worldbody></mujoco>", encoding="utf-8"
    )
    return path / "m.xml"


def refusal(path: Path) -> str:
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
def test_a_size_beyond_any_robots_is_refused_before_memory_is_taken(
    tmp_path: Path, parts: dict[str, str], problem: str
) -> None:
    assert refusal(model(tmp_path, **parts)) == problem


def test_included_files_count_too(tmp_path: Path) -> None:
    (tmp_path / "more.xml").write_text(f'<mujoco><replicate count="1e9">{GEOM}</replicate></mujoco>', encoding="utf-8")
    path = model(tmp_path, world='<include file="more.xml"/>')
    assert refusal(path) == f'{tmp_path / "more.xml"}: <replicate count="1e9"> makes more than 100000 elements'
    (tmp_path / "more.xml").write_text('<mujoco><include file="m.xml"/></mujoco>', encoding="utf-8")
    check_mjcf_bounds(path)  # files that include each other: MuJoCo says so
    assert "already included" in refusal(path)


def test_a_usual_size_is_accepted(tmp_path: Path) -> None:
    hfield = '<hfield name="h" nrow="1000" ncol="1000" size="1 1 1 1"/>'
    check_mjcf_bounds(model(tmp_path, asset=hfield, world=f'<replicate count="100">{GEOM}</replicate>'))


@pytest.mark.parametrize("value", ["nan", "1e300", "inf"])
def test_a_place_that_is_no_number_is_refused_and_nothing_is_printed_or_left(
    tmp_path: Path, value: str, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """MuJoCo itself warns of NaN on stderr, in a file MUJOCO_LOG.TXT, and lets it pass."""
    monkeypatch.chdir(tmp_path)
    path = model(tmp_path, world=f'<body name="arm" pos="{value} 0 0"><joint name="j"/>{GEOM}</body>')
    with pytest.raises(InputError) as caught:
        describe_mjcf(path)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")
    assert [file.name for file in tmp_path.iterdir()] == ["m.xml"]
