"""`prepare --song`: a MIDI file becomes the goals of a piano policy, with a report."""

from __future__ import annotations

import hashlib
import json
import re
from collections import Counter
from collections.abc import Iterable

from rich.console import Console

from humanoid_sim.assets import song_path
from humanoid_sim.errors import InputError, blaming
from humanoid_sim.policy.motion import Motion, motion_bytes
from humanoid_sim.policy.song import Song, goals, key_name, key_number, read_song, thin_out, transpose, with_lead_in
from humanoid_sim.prepare import PrepareOptions
from humanoid_sim.prepare.outputs import Content
from humanoid_sim.robots.piano import KEY_COUNT

SONG_RATE = 50.0
"""Hz of the goals where neither a policy nor the user gives a rate."""
_LONGEST_LEAD_IN = 60.0
"""s"""


def prepare_song(options: PrepareOptions, policy_dt: float, console: Console) -> dict[str, Content]:
    """Return the files of a song: its goals, `policy_dt` s apart, and a report."""
    assert options.song is not None
    path = song_path(options.song)
    if not 0.0 <= options.lead_in <= _LONGEST_LEAD_IN:
        raise InputError(f"--lead-in: is {options.lead_in:g} s, expected 0 to {_LONGEST_LEAD_IN:g} s")
    whole = read_song(path, tracks=options.tracks or None, sustain=options.sustain)
    lowest, highest = _range(options.keys)
    song, dropped = thin_out(transpose(whole, options.transpose), range(lowest, highest + 1), options.voices)
    if not song.notes:
        keys = [note.key + options.transpose for note in whole.notes]
        raise InputError(
            f"{path}: none of its {len(whole.notes)} notes is between {key_name(lowest)} and {key_name(highest)}; "
            f"they are between {key_name(min(keys))} and {key_name(max(keys))}: try --transpose"
        )
    song = with_lead_in(song, options.lead_in)
    table = goals(song, policy_dt)
    name = options.name or re.sub(r"[^\w.-]+", "_", path.stem) or "song"
    beyond = [note.key for note in dropped if not lowest <= note.key <= highest]
    crowded = [note.key for note in dropped if lowest <= note.key <= highest]
    report = {
        "source": str(path),
        "kind": "song",
        "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        "policy_dt": policy_dt,
        "frames": len(table),
        "seconds": song.seconds,
        "notes": len(song.notes),
        "transpose": options.transpose,
        "lowest": key_name(min(note.key for note in song.notes)),
        "highest": key_name(max(note.key for note in song.notes)),
        "most_keys_at_once": int(table.sum(axis=1).max()),
        "left_out": {"beyond the keys": _counted(beyond), "too many voices": _counted(crowded)},
    }
    _print(console, report, whole, options)
    with blaming(path):
        motion = Motion(table, (), policy_dt, task_type="piano", robot=options.robot)
    return {
        f"{name}.mcap": motion_bytes(motion),
        f"{name}.json": (json.dumps(report, indent=2, ensure_ascii=False) + "\n").encode(),
    }


def _range(text: str | None) -> tuple[int, int]:
    if text is None:
        return 0, KEY_COUNT - 1
    first, _, last = text.partition("-") if text.count("-") == 1 else ("", "", "")
    low, high = key_number(first), key_number(last)
    if low is None or high is None or low > high:
        raise InputError(f"--keys: is '{text}', expected the lowest and the highest key of A0 to C8, such as C3-C6")
    return low, high


def _counted(keys: Iterable[int]) -> dict[str, int]:
    """Return how many notes of each key, from the lowest up."""
    return {key_name(key): count for key, count in sorted(Counter(keys).items())}


def _print(console: Console, report: dict[str, object], whole: Song, options: PrepareOptions) -> None:
    tracks = ", ".join(f"{i} {name or 'unnamed'}" for i, name in enumerate(whole.tracks))
    lines = [
        f"song {report['source']}: tracks {tracks}",
        f"{report['notes']} of {len(whole.notes)} notes, {report['lowest']} to {report['highest']}, "
        f"{report['seconds']:.1f} s, at most {report['most_keys_at_once']} keys at once",
    ]
    left_out = report["left_out"]
    assert isinstance(left_out, dict)
    hints = {"beyond the keys": "--transpose moves the song", "too many voices": f"--voices is {options.voices}"}
    for why, counts in left_out.items():
        if counts:
            keys = ", ".join(f"{key} ({count})" if count > 1 else key for key, count in counts.items())
            lines.append(f"left out, {why}: {keys}; {hints[why]}")
    for line in lines:
        console.print(line, markup=False)
