"""Every page reads alike in the repository (CommonMark, with tables) and in the site (Python-Markdown)."""

import re
from collections import Counter
from pathlib import Path

import pytest

markdown = pytest.importorskip("markdown", reason="Python-Markdown is not installed (extra docs)")
pytest.importorskip("pymdownx", reason="pymdown-extensions is not installed (extra docs)")
markdown_it = pytest.importorskip("markdown_it")

ROOT = Path(__file__).parent.parent.parent
PAGES = sorted(
    [*(ROOT / "docs").rglob("*.md"), *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md"))]
)
BLOCKS = ("h1", "h2", "h3", "h4", "li", "ol", "ul", "p", "pre", "table", "td", "a", "em", "strong", "img")


def in_repository(text):
    return str(markdown_it.MarkdownIt("commonmark").enable("table").render(text))


def in_site(text):
    return str(markdown.markdown(text, extensions=["tables", "pymdownx.superfences", "pymdownx.betterem"]))


def elements(html):
    """How often each kind of element comes; paragraphs of list items are none, as loose and tight lists differ."""
    html = re.sub(r"(<li>)\s*<p>(.*?)</p>", r"\1\2", html, flags=re.DOTALL)
    return Counter(name for name in re.findall(r"<(\w+)[ >]", html) if name in BLOCKS)


@pytest.mark.parametrize("page", PAGES, ids=[str(page.relative_to(ROOT)) for page in PAGES])
def test_a_page_has_the_same_elements_in_both(page):
    text = page.read_text(encoding="utf-8")
    assert elements(in_site(text)) == elements(in_repository(text))


def test_a_difference_is_noticed():
    assert elements(in_site("- [ ] a\n\n  b\n- c\n")) != elements(in_repository("- [ ] a\n\n  b\n- c\n"))
