"""Small changes of a Python file that a test should notice."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

_PAIRS: dict[type[ast.AST], tuple[str, str]] = {
    **{ast.Add: ("+", "-"), ast.Sub: ("-", "+"), ast.Mult: ("*", "/"), ast.Div: ("/", "*")},
    **{ast.Lt: ("<", "<="), ast.LtE: ("<=", "<"), ast.Gt: (">", ">="), ast.GtE: (">=", ">")},
    **{ast.Eq: ("==", "!="), ast.NotEq: ("!=", "=="), ast.Is: ("is", "is not"), ast.IsNot: ("is not", "is")},
    **{ast.In: ("in", "not in"), ast.NotIn: ("not in", "in"), ast.And: ("and", "or"), ast.Or: ("or", "and")},
}
"""An operator, and the one in its place."""
_SYMMETRIC = {"min", "max", "minimum", "maximum", "add", "multiply", "hypot", "isclose", "array_equal", "allclose"}
"""Functions whose first two arguments may change places."""
_ASIDE = {"strict", "dtype", "daemon", "name", "copy", "exist_ok", "flush", "end", "file", "stacklevel"}
"""Keywords whose values decide nothing about motion."""


@dataclass(frozen=True, slots=True)
class Change:
    """One change of one file."""

    path: Path
    """From the root of the tree."""
    function: str
    """Qualified name of what it is in."""
    line: int
    start: int
    """Bytes of the file that are replaced: from this one on."""
    end: int
    new: bytes
    before: str
    """The line, or the statement, on one line."""
    after: str

    def __str__(self) -> str:
        """Return what identifies it, also after the lines around it have changed."""
        return f"{self.path} {self.function}: {self.before} -> {self.after}"

    def applied(self, source: bytes) -> bytes:
        """Return the file with the change."""
        return source[: self.start] + self.new + source[self.end :]


def changes_of(root: Path, path: Path) -> list[Change]:
    """Return every change of a file; of some with the same text one."""
    file = _File(path, (root / path).read_bytes())
    return list({str(change): change for change in file.changes()}.values())


class _File:
    def __init__(self, path: Path, source: bytes) -> None:
        self._path, self._source = path, source
        self._starts = [0]
        for line in source.splitlines(keepends=True):
            self._starts.append(self._starts[-1] + len(line))

    def changes(self) -> Iterator[Change]:
        """Yield each."""
        for node, function in _nodes(ast.parse(self._source), ()):
            for start, end, new in self._edits(node, function):
                line = next(i for i, first in enumerate(self._starts) if first > start)
                is_within = end <= self._starts[line]
                begin, stop = (self._starts[line - 1], self._starts[line]) if is_within else (start, end)
                texts = self._source[begin:stop], self._source[begin:start] + new + self._source[end:stop]
                before, after = (" ".join(text.decode().split()) for text in texts)
                yield Change(self._path, ".".join(function), line, start, end, new, before, after)

    def _edits(self, node: ast.AST, function: Sequence[str]) -> Iterator[tuple[int, int, bytes]]:
        """Yield bytes to replace, from one up to another, and by what."""
        match node:
            case ast.BinOp(left, kind, right) if not (_is_text(left) or _is_text(right)):
                yield from self._operator(left, kind, right)
            case ast.BoolOp(kind, [left, right, *_]):
                yield from self._operator(left, kind, right)
            case ast.Compare(first, kinds, others):
                for before, compared, after in zip((first, *others), kinds, others, strict=False):
                    yield from self._operator(before, compared, after)
            case ast.UnaryOp(ast.USub()):
                yield self._at(node)[0], self._at(node)[0] + 1, b" "
            case ast.UnaryOp(ast.Not()):
                yield self._at(node)[0], self._at(node)[0] + 3, b""
            case ast.Constant(int(value) | float(value)):
                yield *self._at(node), repr(_other(value)).encode()
            case ast.Call(called, [first, second, *_]) if ast.unparse(called).rpartition(".")[-1] not in _SYMMETRIC:
                (start, middle), (begin, end) = self._at(first), self._at(second)
                texts = self._source[start:middle], self._source[begin:end]
                if texts[0] != texts[1] and b"*" not in (texts[0][:1], texts[1][:1]):
                    yield start, end, texts[1] + self._source[middle:begin] + texts[0]
            case ast.Expr(ast.Call()) | ast.AugAssign():
                yield *self._at(node), b"pass"
            case ast.Assign([ast.Attribute() | ast.Subscript()]) if function[-1:] != ("__init__",):
                yield *self._at(node), b"pass"

    def _operator(self, left: ast.expr, kind: ast.AST, right: ast.expr) -> Iterator[tuple[int, int, bytes]]:
        old, new = _PAIRS.get(type(kind), ("", ""))
        start, end = self._at(left)[1], self._at(right)[0]
        place = self._source.find(old.encode(), start, end)
        if old and place >= 0:
            yield place, place + len(old), new.encode()

    def _at(self, node: ast.expr | ast.stmt) -> tuple[int, int]:
        """Return where it begins in the file, and where it ends, in bytes."""
        last, end = node.end_lineno or node.lineno, node.end_col_offset or 0
        return self._starts[node.lineno - 1] + node.col_offset, self._starts[last - 1] + end


def _nodes(node: ast.AST, names: tuple[str, ...]) -> Iterator[tuple[ast.AST, tuple[str, ...]]]:
    """Yield what decides something and the names that it is in: no messages, invariants, annotations or decorators."""
    inside: list[ast.AST] = list(ast.iter_child_nodes(node))
    match node:
        case ast.Raise() | ast.Assert() | ast.JoinedStr() | ast.Import() | ast.ImportFrom():
            return
        case ast.If(ast.Name("TYPE_CHECKING")):
            return
        case ast.keyword(name) if name in _ASIDE:
            return
        case ast.FunctionDef() | ast.ClassDef():
            inside, names = list(node.body), (*names, node.name)
        case ast.AnnAssign():
            inside = [] if node.value is None else [node.value]
    yield node, names
    for child in inside:
        yield from _nodes(child, names)


def _other(value: float) -> float:
    if isinstance(value, bool):
        return not value
    return value + 1 if isinstance(value, int) else 1000.0 * value or 1.0


def _is_text(node: ast.expr) -> bool:
    match node:
        case ast.JoinedStr() | ast.List() | ast.Tuple() | ast.Constant(str() | bytes()):
            return True
    return False
