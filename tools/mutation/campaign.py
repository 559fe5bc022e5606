"""Runs the tests against changes, in copies of the tree, and tells which survive."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import ExitStack
from pathlib import Path
from queue import SimpleQueue

import yaml

from humanoid_sim.errors import InputError, known_names
from humanoid_sim.files import whole_file
from humanoid_sim.strict_yaml import read_yaml
from tools.mutation import MutationConfig
from tools.mutation.changes import Change, changes_of

_ROOT = Path(__file__).parents[2]
_EQUIVALENT, _KILLERS = (Path(__file__).with_name(f"{name}.yaml") for name in ("equivalent", "killers"))
_PARTS: dict[str, tuple[str, ...]] = {
    "mit": ("humanoid_sim/mit.py",),
    "controllers": ("controllers/*.py",),
    "session": ("humanoid_sim/session/*.py",),
    "adapter": ("hardware/adapter/*.py",),
    "protocols": ("hardware/robstride/*.py", "hardware/sito/*.py"),
    "plants": tuple(
        f"humanoid_sim/simulation/{name}.py"
        for name in ("plant", "mujoco_robot", "sensors", "floating_base", "gravity", "push", "keys")
    ),
}
_TELLING = {"statistics", "losses", "monitor", "registration", "parameters"}
"""Modules of these parts that tell people something, or name it, and decide nothing."""
_FURTHER = {"robstride": ("adapter", "tools"), "sito": ("adapter", "tools")}
"""Folders whose tests show what a folder's modules do, beside its own."""
_COPIED = ("humanoid_sim", "controllers", "envs", "hardware", "assets", "tests", "tools", "examples", "pyproject.toml")
_NICENESS = 10
_LONGEST = 600.0
"""s that the tests of one change may take; a change with which they hang is noticed."""
_FAILED = re.compile(r"^(?:FAILED|ERROR) (\S+?)(?: - .*)?$", re.MULTILINE)
_NOTHING = (4, 5)
"""Statuses of pytest where it found no tests."""


def campaign(config: MutationConfig) -> int:
    """Try the changes; returns the exit status. Raises `InputError` if an option is out of range."""
    for name in config.part:
        if name not in _PARTS:
            raise InputError(f"--part: {known_names('part', name, _PARTS)}")
    if config.count < 1 or config.jobs < 1:
        raise InputError(f"--count, --jobs: are {config.count} and {config.jobs}, expected at least 1")
    chosen = choose(config.part or tuple(_PARTS), config.seed, config.count)
    if config.list:
        print("\n".join(f"{change.path}:{change.line} {change}" for change in chosen))
        return 0
    reasons: dict[str, str] = read_yaml(_EQUIVALENT)
    killers: dict[str, str] = read_yaml(_KILLERS)
    tried = [change for change in chosen if str(change) not in reasons]
    noticed: dict[Change, str | None] = {}
    os.nice(_NICENESS)
    with ExitStack() as stack:
        copies: SimpleQueue[Copy] = SimpleQueue()
        for _ in range(config.jobs):
            copies.put(Copy(Path(stack.enter_context(tempfile.TemporaryDirectory()))))

        def run(change: Change) -> tuple[Change, str | None]:
            copy = copies.get()
            try:
                return change, copy.notices(change, killers.get(str(change)))
            finally:
                copies.put(copy)

        with ThreadPoolExecutor(config.jobs) as pool:
            for change, killer in (
                done.result() for done in as_completed(pool.submit(run, change) for change in tried)
            ):
                noticed[change] = killer
                print(
                    f"{change.path}:{change.line} {killer or 'SURVIVES'}\n    {change.before}\n    {change.after}",
                    flush=True,
                )
    survivors = sum(killer is None for killer in noticed.values())
    print(f"{len(noticed)} changes, {survivors} survive; {len(chosen) - len(tried)} more are known to change nothing")
    if config.remember:
        known = killers | {str(change): killer for change, killer in noticed.items() if killer is not None}
        with whole_file(_KILLERS) as file:
            file.write(yaml.safe_dump(known, width=1000).encode())
    return 1 if survivors else 0


def choose(parts: tuple[str, ...], seed: int, count: int) -> list[Change]:
    """Return so many changes, of each part in turn, in an order by chance that each one's own text decides."""
    ranked = [iter(sorted(_all(part), key=lambda change: _rank(seed, change))) for part in parts]
    turns: list[Change] = []
    while ranked and len(turns) < count:
        for part in list(ranked):
            change = next(part, None)
            if change is None:
                ranked.remove(part)
            else:
                turns.append(change)
    return turns[:count]


def _rank(seed: int, change: Change) -> bytes:
    return hashlib.sha256(f"{seed} {change}".encode()).digest()


def _all(part: str) -> Iterator[Change]:
    for pattern in _PARTS[part]:
        for file in sorted(_ROOT.glob(pattern)):
            if file.stem not in _TELLING:
                yield from changes_of(_ROOT, file.relative_to(_ROOT))


def tests_of(path: Path) -> list[list[str]]:
    """Return the tests that mirror a module: its own file, others of its package that import it, then the package."""
    inside = path.relative_to("humanoid_sim") if path.parts[0] == "humanoid_sim" else path
    folder = Path("tests") / inside.parent
    own = folder / f"test_{path.stem}.py"
    module = ".".join(inside.with_suffix("").parts)
    others = [] if folder == Path("tests") else sorted((_ROOT / folder).glob("test_*.py"))
    near = [file.relative_to(_ROOT) for file in others if f"humanoid_sim.{module} " in file.read_text(encoding="utf-8")]
    first = list(dict.fromkeys([*([own] if (_ROOT / own).is_file() else []), *near]))
    rest = [file.relative_to(_ROOT) for file in others if file.relative_to(_ROOT) not in first]
    further = [folder.with_name(name) for name in _FURTHER.get(folder.name, ())]
    return [[str(file) for file in files] for files in (first, rest, further) if files]


class Copy:
    """A copy of the tree, so that a run that is interrupted leaves nothing in the tree itself."""

    def __init__(self, folder: Path) -> None:
        """Copy what tests need, with what Python has compiled."""
        self._folder = folder
        for name in _COPIED:
            if (_ROOT / name).is_dir():
                shutil.copytree(_ROOT / name, folder / name, symlinks=True)
            else:
                shutil.copy2(_ROOT / name, folder / name)
        if self._run(["tests/test_names.py"]) != (0, ""):
            raise InputError("tests/test_names.py fails as it is; expected a tree whose tests pass")

    def notices(self, change: Change, killer: str | None) -> str | None:
        """Return the first test that fails with a change; None if it survives.

        Args:
            change: to try.
            killer: a test that noticed it before.
        """
        place = self._folder / change.path
        source = place.read_bytes()
        try:
            self._write(place, change.applied(source))
            for tests in ([[killer]] if killer else []) + tests_of(change.path):
                status, failed = self._run(tests)
                if status not in (0, *_NOTHING):
                    return failed
        finally:
            self._write(place, source)
        return None

    def _write(self, place: Path, source: bytes) -> None:
        place.write_bytes(source)
        for compiled in (place.parent / "__pycache__").glob(f"{place.stem}.*"):  # it may look as new as the source
            compiled.unlink()

    def _run(self, tests: list[str]) -> tuple[int, str]:
        """Return pytest's status, and the first test that failed."""
        environment = {**os.environ, "PYTHONPATH": str(self._folder)}
        command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "--timeout=60", *tests]
        try:
            result = subprocess.run(
                command,
                cwd=self._folder,
                env=environment,
                capture_output=True,
                text=True,
                timeout=_LONGEST,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return 1, "hangs"
        failed = _FAILED.search(result.stdout)
        return result.returncode, failed[1] if failed else "" if result.returncode == 0 else "ends with an error"
