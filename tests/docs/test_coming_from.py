"""The page for users of the original system names what exists."""

import re
from pathlib import Path

import msgspec

from humanoid_sim.robots.description import load_robot

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "coming-from-humanoid-control.md").read_text(encoding="utf-8")
NAMED = re.compile(r"`(?P<file>tests/[\w/]+\.py)`|`(?P<test>test_\w+)`|\[[^]]+\]\((?P<page>[\w-]+\.md)")


def missing(page):
    """Rows that a test holds, and the names in them that do not exist; 'the same' is the row before."""
    rows = [
        line for line in page.rsplit("## Statement by statement", maxsplit=1)[-1].splitlines() if line.startswith("| ")
    ]
    file, gone, held = "", [], 0
    for row in rows:
        cell = row.strip("| ").rpartition(" | ")[2]
        for found in NAMED.finditer(cell):
            held += 1
            if found["file"]:
                file = found["file"]
            text = (ROOT / file).read_text(encoding="utf-8") if file and (ROOT / file).is_file() else ""
            if found["test"] and f"def {found['test']}(" not in text:
                gone.append(f"{file}: {found['test']}")
            elif found["page"] and not (ROOT / "docs" / found["page"]).is_file():
                gone.append(found["page"])
        if not NAMED.search(cell) and cell not in ("the same", "held by"):
            gone.append(row)
    return held, gone


def test_every_statement_is_held_by_a_test_or_a_page_that_exists():
    held, gone = missing(PAGE)
    assert gone == []
    assert held > 100


def test_a_name_that_does_not_exist_is_noticed():
    assert missing("## Statement by statement\n| x | `tests/test_mit.py`: `test_gone` |")[1] == [
        "tests/test_mit.py: test_gone"
    ]
    assert missing("## Statement by statement\n| x | somewhere |")[1] == ["| x | somewhere |"]


def test_the_lite_is_the_original_s():
    lite = load_robot("lite")
    assert (lite.hardware.control_frequency, lite.simulation.control_frequency) == (50.0, 200.0)
    for standby in (lite.standby_controller_a, lite.standby_controller_b):
        assert standby.segment_durations == (2.0, 2.0)
        assert standby.pose_segments[0] == (0.0,) * 14
    a, b = (msgspec.structs.asdict(one) for one in (lite.standby_controller_a, lite.standby_controller_b))
    assert {name for name in a if a[name] != b[name]} == {"pose_segments"}
    ready = (0.3, -1.0, 0.0, -1.7, -1.2, 0.0, 0.3, 0.3, 1.0, 0.0, -1.7, 1.2, 0.0, -0.3)
    assert lite.standby_controller_a.pose_segments[1] == ready
