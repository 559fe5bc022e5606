"""Build the documentation as a site, strictly: `make docs`, or `python docs/build.py`; `--serve` serves it then.

The site is made of the Markdown files and notebooks that the repository shows anyway. They are staged in
`build/site-source`, where README.md is the first page and links lead from page to page, and built into `build/site`. A
link or anchor that leads nowhere is an error, and so is anything that a page would load from another server. Links to
the outside are listed, and not followed.
"""

from __future__ import annotations

import argparse
import ast
import base64
import contextlib
import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from html.parser import HTMLParser
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path, PurePosixPath
from urllib.parse import unquote, urlsplit

ROOT = Path(__file__).resolve().parent.parent
DOCS, NOTEBOOKS = PurePosixPath("docs"), PurePosixPath("notebooks")
ROOT_PAGES = {"README.md": "index.md", "CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}
"""Files beside docs/ that are pages too, and as what."""
DIAGRAM = re.compile(r"^ *```mermaid$", re.MULTILINE)
LINK = re.compile(r"\[([^\]]*)\]\((?!https?:|mailto:|#)([^)#\s]+)(#[^)\s]*)?\)")
"""A Markdown link to a file: its text, the path, the anchor."""
STRUCTS = re.compile(r"^<!-- structs: ([\w.]+), (\w+) first(?:, without (\w+))? -->$", re.MULTILINE)
"""In whose place a page gets the fields of all structs of a module: which one comes first, which field is none."""
PICTURES = {"image/png": "png", "image/webp": "webp"}
"""Pictures that a notebook can show, and their files' suffixes."""
LATE = ("contributing.html", "changelog.html", "reference/")
"""Pages that a search shows after guides."""
GAP = "\u2060\u200a" * 100
"""Invisible words with which their texts in the search begin."""
TITLE = re.compile(r"^# (.+)$", re.MULTILINE)


class SiteError(Exception):
    """Problems of the site, a line each."""


def page_of(path: PurePosixPath) -> PurePosixPath | None:
    """Return where a file of the repository is in the site; None if it is not there."""
    if str(path) in ROOT_PAGES:
        return PurePosixPath(ROOT_PAGES[str(path)])
    if path.parent == NOTEBOOKS and path.suffix == ".ipynb":
        return path.with_suffix(".md")
    return path.relative_to(DOCS) if path.is_relative_to(DOCS) else None


def with_structs(match: re.Match[str]) -> str:
    """Directives for the reference that list every field of every struct of a module."""
    module, first, left_out = match.groups()
    tree = ast.parse((ROOT / f"{module.replace('.', '/')}.py").read_text("utf-8"))
    structs = [
        node
        for node in tree.body
        if isinstance(node, ast.ClassDef) and any(ast.unparse(base) == "msgspec.Struct" for base in node.bases)
    ]
    blocks = []
    for struct in sorted(structs, key=lambda struct: struct.name != first):
        fields = [str(ast.unparse(node.target)) for node in struct.body if isinstance(node, ast.AnnAssign)]
        members = ", ".join(name for name in fields if name != left_out)
        options = f"    options:\n      show_if_no_docstring: true\n      members: [{members}]\n"
        blocks.append(f"::: {module}.{struct.name}\n{options}")
    return "\n".join(blocks)


def staged(text: str, source: PurePosixPath) -> str:
    """Return a page's Markdown for the site: links lead to pages, by their titles, and a script draws its diagrams."""
    page = page_of(source)
    assert page is not None

    def to_page(match: re.Match[str]) -> str:
        shown, path, anchor = match.groups(default="")
        target = PurePosixPath(os.path.normpath(source.parent / path))
        found = page_of(target)
        if found is None or not (ROOT / target).is_file():
            raise SiteError(f"{source}: links to {path}, which is not a page of the site")
        if shown in (str(target), target.name):  # a reader of the site knows no files
            title = TITLE.search((ROOT / target).read_text("utf-8"))
            shown = title[1] if title else shown
        return f"[{shown}]({os.path.relpath(found, page.parent)}{anchor})"

    text = STRUCTS.sub(with_structs, LINK.sub(to_page, text))
    if DIAGRAM.search(text):
        text += f'\n\n<script src="{os.path.relpath("mermaid.js", page.parent)}"></script>\n'
    return text


def notebook_page(text: str, source: PurePosixPath) -> tuple[str, dict[str, bytes]]:
    """Return a notebook's Markdown for the site, its cells and what they show, and its pictures by their names."""
    parts: list[str] = []
    pictures: dict[str, bytes] = {}
    for cell in json.loads(text)["cells"]:
        written = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(staged(written, source))
            continue
        parts.append(f"```python\n{written}\n```")
        for output in cell["outputs"]:
            data = output.get("data", {"text/plain": output.get("text", "")})
            kind = next((kind for kind in PICTURES if kind in data), None)
            if kind is None:
                shown = "".join(data["text/plain"]).rstrip()
                parts.append(f"```text\n{shown}\n```")
            else:
                name = f"{source.stem}-{len(pictures) + 1}.{PICTURES[kind]}"
                pictures[name] = base64.b64decode("".join(data[kind]))
                parts.append(f"![What the code above shows]({name})")
    return "\n\n".join(parts) + "\n", pictures


def stage(folder: Path) -> None:
    """Put everything that the site is made of into a folder."""
    shutil.rmtree(folder, ignore_errors=True)
    pages = folder / "docs"
    shutil.copytree(ROOT / DOCS, pages, ignore=shutil.ignore_patterns("*.py", "*.toml", "__pycache__"))
    for path in (*(ROOT / DOCS).rglob("*.md"), *(ROOT / name for name in ROOT_PAGES)):
        source = PurePosixPath(path.relative_to(ROOT).as_posix())
        (pages / (page_of(source) or "")).write_text(staged(path.read_text("utf-8"), source), "utf-8")
    (pages / NOTEBOOKS).mkdir()
    for path in (ROOT / NOTEBOOKS).glob("*.ipynb"):
        source = PurePosixPath(path.relative_to(ROOT).as_posix())
        text, pictures = notebook_page(path.read_text("utf-8"), source)
        (pages / source.with_suffix(".md")).write_text(text, "utf-8")
        for name, content in pictures.items():
            (pages / NOTEBOOKS / name).write_bytes(content)
    package = importlib.util.find_spec("mermaidx")
    if package is None or package.origin is None:
        raise SiteError("the site needs the package 'mermaidx', which is not installed: pip install -e '.[docs]'")
    shutil.copy(Path(package.origin).parent / "assets" / "mermaid.js", pages)
    shutil.copy(ROOT / DOCS / "zensical.toml", folder)


@dataclass
class Page(HTMLParser):
    """A built page's own data: where it can be linked to, where it leads, what it loads."""

    text: str
    anchors: set[str] = field(default_factory=set)
    links: set[str] = field(default_factory=set)
    resources: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        super().__init__()
        self.feed(self.text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note where an element can be found, and what it refers to."""
        given = {name: value for name, value in attrs if value is not None}
        self.anchors |= {given[name] for name in ("id", "name") if name in given}
        if tag == "a" and "href" in given:
            self.links.add(given["href"])
        elif "src" in given or ("href" in given and tag in ("link", "image", "use")):
            self.resources.add(given.get("src") or given["href"])


def problems_and_outside(pages: Mapping[str, Page], files: Iterable[str]) -> tuple[list[str], dict[str, str]]:
    """Return what is wrong between built pages, and each link to the outside with a page that has it.

    Args:
        pages: by their paths in the site.
        files: paths of everything in the site.
    """
    known = set(files)
    problems, outside = [], {}
    for path, page in sorted(pages.items()):
        for target in sorted(page.resources | page.links):
            parts = urlsplit(target)
            if parts.scheme in ("data", "javascript"):
                continue
            if parts.scheme or parts.netloc:
                if target in page.resources:
                    problems.append(f"{path}: loads {target} from elsewhere")
                else:
                    outside.setdefault(target, path)
                continue
            place = os.path.normpath(PurePosixPath(path).parent / unquote(parts.path)) if parts.path else path
            if os.path.normpath(f"{place}/index.html") in known:  # what a server shows of a folder
                place = os.path.normpath(f"{place}/index.html")
            if place not in known:
                problems.append(f"{path}: {target} does not exist")
            elif parts.fragment and place in pages and unquote(parts.fragment) not in pages[place].anchors:
                problems.append(f"{path}: {target} has no such anchor")
    return problems, outside


def check(site: Path) -> None:
    """Check a built site, and list what it links to outside."""
    files = [path.relative_to(site).as_posix() for path in site.rglob("*") if path.is_file()]
    pages = {name: Page((site / name).read_text("utf-8")) for name in files if name.endswith(".html")}
    pages.pop("404.html", None)  # its addresses begin at the root of whatever server shows it
    problems, outside = problems_and_outside(pages, files)
    if problems:
        raise SiteError("\n".join(problems))
    print(f"{len(pages)} pages, {sum(len(page.links) for page in pages.values())} links between and out of them")
    print("links to the outside, not followed:")
    for target, page in sorted(outside.items()):
        print(f"  {target}  ({page})")


def rank(index: dict[str, list[dict[str, str]]]) -> None:
    """Have a search show late pages after all others.

    It knows no weights of pages: headings come before text, and then what has the word sooner. So a heading becomes
    text, behind words that nobody sees, and what is shown in its place has invisible joints between its
    letters, by which nobody searches.
    """
    for item in index["items"]:
        if item["location"].startswith(LATE):
            item["text"] = f"<p>{GAP}</p><p>{item['title']}</p>{item['text']}"
            item["title"] = re.sub(r"(?<=\w)(?=\w)", "\u2060", item["title"])


def rank_search(site: Path) -> None:
    """Rank a site's search, for a server and for pages that are opened as files."""
    index = json.loads((site / "search.json").read_text("utf-8"))
    rank(index)
    text = json.dumps(index, ensure_ascii=False)
    (site / "search.json").write_text(text, "utf-8")
    (site / "search.js").write_text(f"var __index = {text}", "utf-8")


def serve(site: Path) -> None:
    """Serve a site on this machine alone, until Ctrl-C."""
    handler = partial(SimpleHTTPRequestHandler, directory=str(site))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server, contextlib.suppress(KeyboardInterrupt):
        print(f"serving on http://127.0.0.1:{server.server_port}/ until Ctrl-C", flush=True)
        server.serve_forever()


def main() -> int:
    """Stage, build and check; returns the exit status."""
    parser = argparse.ArgumentParser(description="Build the documentation as a site, in build/site.")
    parser.add_argument("--serve", action="store_true", help="serve it then, on 127.0.0.1, and print the address")
    wants_server = parser.parse_args().serve
    source, site = ROOT / "build" / "site-source", ROOT / "build" / "site"
    try:
        stage(source)
        command = [sys.executable, "-m", "zensical", "build", "--strict", "--clean"]
        if subprocess.run(command, cwd=source, env={**os.environ, "NO_COLOR": "1"}, check=False).returncode:
            raise SiteError("the site was not built")
        rank_search(source / "site")
        check(source / "site")
        shutil.rmtree(site, ignore_errors=True)
        (source / "site").replace(site)
    except SiteError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    print(f"built: {site / 'index.html'}")
    if wants_server:
        serve(site)
    return 0


if __name__ == "__main__":
    sys.exit(main())
