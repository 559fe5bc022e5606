"""docs/build.py: what it stages, and what it finds wrong with a built site."""

import json
import re
from pathlib import Path, PurePosixPath

import pytest
from script_files import load_script

from humanoid_sim.regress import suite
from humanoid_sim.robots import schema


@pytest.fixture(scope="module")
def build():
    return load_script(Path(__file__).parent.parent.parent / "docs" / "build.py")


@pytest.mark.parametrize(
    ("source", "text", "expected"),
    [
        ("README.md", "[a](docs/play.md#modes) ![b](docs/play.webp)", "[a](play.md#modes) ![b](play.webp)"),
        ("docs/concepts.md", "[a](../CONTRIBUTING.md#layout)", "[a](contributing.md#layout)"),
        ("docs/guides/researcher.md", "[a](../play.md) [b](../../README.md)", "[a](../play.md) [b](../index.md)"),
        ("README.md", "[docs/figures.md](docs/figures.md)", "[Figures](figures.md)"),
        ("docs/checklist.md", "[figures.md](figures.md#x) say", "[Figures](figures.md#x) say"),
        ("docs/play.md", "[a](../notebooks/3_regression.ipynb)", "[a](notebooks/3_regression.md)"),
        ("notebooks/3_regression.ipynb", "[a](../docs/play.md) [b](../README.md)", "[a](../play.md) [b](../index.md)"),
        ("docs/play.md", "[a](#here) [b](https://example.org/x.md)", "[a](#here) [b](https://example.org/x.md)"),
    ],
)
def test_links_lead_to_pages(build, source, text, expected):
    assert build.staged(text, PurePosixPath(source)) == expected


@pytest.mark.parametrize("target", ["nowhere.md", "../LICENSE", "../tests/conftest.py"])
def test_a_link_out_of_the_site_is_an_error(build, target):
    with pytest.raises(build.SiteError, match=f"docs/play.md: links to {target}, which is not a page of the site"):
        build.staged(f"[a]({target})", PurePosixPath("docs/play.md"))


def test_a_page_with_a_diagram_gets_its_script(build):
    text = "```mermaid\nflowchart TB\n```\n"
    assert build.staged(text, PurePosixPath("docs/guides/researcher.md")).endswith(
        '\n<script src="../mermaid.js"></script>\n'
    )


def test_a_notebook_is_a_page_with_its_pictures_beside_it(build):
    printed = {"output_type": "stream", "name": "stdout", "text": ["1\n", "2\n"]}
    drawn = {"output_type": "display_data", "data": {"text/plain": ["<Figure>"], "image/png": "aGVsbG8=\n"}}
    cells = [
        {"cell_type": "markdown", "source": ["# Walk\n", "[how](../docs/training.md)"]},
        {"cell_type": "code", "source": ["a[0](1)"], "outputs": [printed, drawn]},
    ]
    page, pictures = build.notebook_page(json.dumps({"cells": cells}), PurePosixPath("notebooks/9_x.ipynb"))
    assert page == (
        "# Walk\n[how](../training.md)\n\n```python\na[0](1)\n```\n\n```text\n1\n2\n```\n\n"
        "![What the code above shows](9_x-1.png)\n"
    )
    assert pictures == {"9_x-1.png": b"hello"}


def test_links_and_resources_of_a_site_are_judged(build):
    pages = {
        "index.html": '<h1 id="top"></h1><a href="a/b.html#here"></a><a href="#top"></a><a href="https://example.org"></a>',
        "a/b.html": '<p id="here"></p><a href=".."></a><a href="c.html"></a><a href="../index.html#gone"></a>'
        '<img src="p%20q.png"><script src="https://cdn.example.org/x.js"></script><link href="//fonts.example.org">',
    }
    built = {name: build.Page(text) for name, text in pages.items()}
    problems, outside = build.problems_and_outside(built, [*pages, "a/p q.png"])
    assert problems == [
        "a/b.html: ../index.html#gone has no such anchor",
        "a/b.html: loads //fonts.example.org from elsewhere",
        "a/b.html: c.html does not exist",
        "a/b.html: loads https://cdn.example.org/x.js from elsewhere",
    ]
    assert outside == {"https://example.org": "index.html"}


def test_a_search_ranks_headings_of_guides_above_those_of_late_pages(build):
    places = ("play.html#modes", "contributing.html#a-task", "reference/types.html#x")
    index = {"items": [{"location": place, "title": "A front_end", "text": "<p>x</p>"} for place in places]}
    build.rank(index)
    guide, *late = index["items"]
    assert (guide["title"], guide["text"]) == ("A front_end", "<p>x</p>")
    for item in late:
        assert item["title"].replace("\u2060", "") == "A front_end"
        assert "front" not in item["title"]
        gap, text = item["text"].removeprefix("<p>").split("</p>", 1)
        assert text == "<p>A front_end</p><p>x</p>"
        assert len(gap.split()) == 100  # words: what has the wanted one sooner comes first


@pytest.mark.parametrize(
    ("page", "module", "first"), [("robot-file", schema, "RobotDescription"), ("suite-file", suite, "Suite")]
)
def test_a_schema_page_gets_every_field_of_every_struct(build, page, module, first):
    source = PurePosixPath("docs", "reference", f"{page}.md")
    text = build.staged((build.ROOT / source).read_text("utf-8"), source)
    listed = re.findall(r"^::: (\S+)\.(\w+)$.*?members: \[(.+?)\]", text, re.MULTILINE | re.DOTALL)
    structs = {name: kind for name, kind in vars(module).items() if hasattr(kind, "__struct_fields__")}
    assert {name for _, name, _ in listed} == {
        name for name, kind in structs.items() if kind.__module__ == module.__name__
    }
    assert listed[0][1] == first
    for place, name, members in listed:
        assert place == module.__name__
        assert members.split(", ") == [field for field in structs[name].__struct_fields__ if field != "folder"]
