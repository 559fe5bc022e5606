"""The pages of the site: each is found in its navigation, and what they list is complete."""

import ast
import re
import tomllib
from pathlib import Path

from humanoid_sim.cli import VERBS, ExitStatus
from humanoid_sim.ros2.definitions import EVENT, SHADOW_STEP, TICK, schema_text

ROOT = Path(__file__).parent.parent.parent
DOCS = ROOT / "docs"
SETTINGS = tomllib.loads((DOCS / "zensical.toml").read_text(encoding="utf-8"))["project"]
REFERENCE = {path.name: path.read_text(encoding="utf-8") for path in (DOCS / "reference").glob("*.md")}
FROM_ROOT = {"index.md", "contributing.md", "changelog.md"}


def in_navigation(entry):
    """The pages of a part of the navigation."""
    if isinstance(entry, str):
        return [entry]
    parts = entry.values() if isinstance(entry, dict) else entry
    return [page for part in parts for page in in_navigation(part)]


def test_every_page_is_in_the_navigation_once():
    shown = in_navigation(SETTINGS["nav"])
    written = {path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")}
    notebooks = {f"notebooks/{path.stem}.md" for path in (ROOT / "notebooks").glob("*.ipynb")}
    assert sorted(shown) == sorted(written | notebooks | FROM_ROOT), "docs/zensical.toml has the navigation"


def test_what_examples_and_pages_import_is_in_the_reference():
    documented = set(re.findall(r"^::: (\S+)", "\n".join(REFERENCE.values()), re.MULTILINE))
    sources = [*ROOT.glob("examples/**/*.py"), *ROOT.glob("examples/**/*.sh"), *DOCS.rglob("*.md")]
    text = "\n".join(path.read_text(encoding="utf-8") for path in sources)
    imported = re.findall(r"^ *from (humanoid_sim[\w.]+) import ([\w, ]+)", text, re.MULTILINE)
    assert len(imported) > 15
    missing = {
        f"{module}.{name}"
        for module, names in imported
        for name in names.split(", ")
        if module != "humanoid_sim.cli" and not {module, f"{module}.{name}"} & documented
    }
    assert missing == set(), "not in docs/reference"


def test_the_page_of_the_feed_has_the_definitions():
    blocks = re.findall(r"```text\n(.*?)\n```", REFERENCE["feed.md"], re.DOTALL)
    assert blocks == [schema_text(name).strip() for name in (TICK, EVENT, SHADOW_STEP)]


def test_the_page_of_exit_statuses_has_every_status_and_known_programs():
    page = (DOCS / "exit-statuses.md").read_text(encoding="utf-8")
    statuses = re.findall(r"^\| (\d+) \|", page, re.MULTILINE)
    assert statuses == [str(status.value) for status in ExitStatus]
    programs = re.findall(r"^\| ((?:`[a-z ]+`(?:, )?)+) \|", page, re.MULTILINE)
    verbs = {name.split()[0] for row in programs for name in re.findall(r"`([^`]+)`", row)}
    assert len(verbs) > 10
    assert verbs <= set(VERBS)


def test_the_citation_is_of_this_version():
    version = next(
        node.value.value
        for node in ast.parse((ROOT / "humanoid_sim" / "__init__.py").read_text(encoding="utf-8")).body
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Constant)
    )
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"version = {{{version}}}" in (DOCS / "citation.md").read_text(encoding="utf-8")
    assert f"\n## {version}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
