"""Reads mutants in a process of its own, with a bound on its memory, and says what came of each.

`python worker.py FOLDER SEED MODULE DESCRIPTOR`: lines `READER NUMBER` come on standard input, answers go to the
descriptor as lines of JSON. What the readers print on descriptors 1 and 2, and the files that they leave behind, are
found by looking, not by asking Python.
"""

import importlib
import json
import os
import resource
import sys
import traceback
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parent))

from formats import mutant
from targets import Target

MEMORY = 3 << 30
"""Bytes of address space beyond what the imports took."""


def main(folder: Path, seed: int, targets: Mapping[str, Target], descriptor: int, *, warm: bool) -> None:
    """Until standard input ends; `warm`: read each sound file first, which imports what it takes and must succeed."""
    answers = os.fdopen(descriptor, "w", buffering=1)
    log = folder / "printed"
    with log.open("wb") as printed:
        os.dup2(printed.fileno(), 1)
        os.dup2(printed.fileno(), 2)
    sound: dict[str, bytes] = {}
    for i, (name, target) in enumerate(targets.items()):
        place = folder / str(i)
        place.mkdir(exist_ok=True)
        sound[name] = target.prepare(place)
        (place / target.file).write_bytes(sound[name])
        if warm:
            target.read(place / target.file)
    in_use = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (in_use + MEMORY, in_use + MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    answers.write("ready\n")
    for line in sys.stdin:
        name, _, number = line.strip().rpartition(" ")
        place = folder / str(list(targets).index(name))
        os.chdir(place)
        before, length = (
            set(os.listdir(place)) | {"recovered.mcap", "recovered.csv", "recovered.urdf"},
            log.stat().st_size,
        )
        outcome = _one(targets[name], place, mutant_of(targets[name], name, sound[name], seed, int(number)))
        left = sorted(set(os.listdir(place)) - before)
        sys.stdout.flush()
        sys.stderr.flush()
        with log.open("rb") as printed:
            printed.seek(length)
            text = printed.read(2000).decode(errors="replace")
        answers.write(json.dumps({**outcome, "printed": text, "left": left}) + "\n")
        for leftover in left:
            (place / leftover).unlink()


def mutant_of(target: Target, name: str, sound: bytes, seed: int, number: int) -> bytes:
    """The mutant of a number: always the same."""
    rng = np.random.default_rng([seed, zlib.crc32(name.encode()), number])
    document = json.loads(sound) if target.kind in ("yaml", "json") else None
    return mutant(sound, target.kind, rng, document)


def _one(target: Target, place: Path, content: bytes) -> dict[str, str]:
    from humanoid_sim.errors import InputError  # noqa: PLC0415

    path = place / target.file
    path.write_bytes(content)
    try:
        target.read(path)
    except InputError as error:
        text = str(error)
        if "\n" in text or not text or len(text) > 10_010:
            return {"came": "found", "text": f"no single line: {text[:300]!r} ({len(text)} characters)"}
        return {"came": "refused", "text": text[:300]}
    except SystemExit as error:
        return {"came": "found", "text": f"exits with {error.code}"}
    except BaseException:
        return {"came": "found", "text": traceback.format_exc()[-1500:]}
    return {"came": "accepted", "text": ""}


if __name__ == "__main__":
    module = sys.argv[3]
    main(
        Path(sys.argv[1]),
        int(sys.argv[2]),
        importlib.import_module(module).TARGETS,
        int(sys.argv[4]),
        warm=module == "targets",
    )
