"""Songs as goals for a piano's keys: the notes of a MIDI file, as rows of 0 and 1 per policy step.

Note on, note off and note on with velocity 0 are those of the Standard MIDI Files 1.0 specification; a change of tempo
holds for all tracks. Key 0 is A0, MIDI note 21, and key 87 is C8, MIDI note 108.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Any

import mido
import numpy as np

from humanoid_sim.assets import sample_songs, song_path
from humanoid_sim.errors import InputError, blaming
from humanoid_sim.files import is_file, regular_file
from humanoid_sim.mit import Float32Array
from humanoid_sim.policy.motion import Motion
from humanoid_sim.robots.piano import FIRST_NOTE, KEY_COUNT
from humanoid_sim.robots.schema import RobotDescription

PERCUSSION = 9  # channel whose notes are drums, counted from 0
_LEAD_IN = 1.0  # s before the first note, in which a robot's hands come over the keys
_GAP = 0.06  # s for which a key is released before it is struck again
_NAMES = ("C", "C#", "D", "D#", "E", "F", "F#", "G", "G#", "A", "A#", "B")


@dataclass(frozen=True, slots=True)
class Note:
    """One note."""

    key: int  # 0 to 87, or beyond where the piano has no such key
    start: float  # s
    end: float  # s
    velocity: int = 64  # 1 to 127, how hard it was struck


@dataclass(frozen=True, slots=True)
class Song:
    """Notes in order of their start, and what the file's tracks are called."""

    notes: tuple[Note, ...]
    tracks: tuple[str, ...]

    @property
    def seconds(self) -> float:
        """End of the last note, s."""
        return max((note.end for note in self.notes), default=0.0)


def key_name(key: int) -> str:
    """Such as `C4` for key 39, middle C."""
    note = key + FIRST_NOTE
    return f"{_NAMES[note % 12]}{note // 12 - 1}"


def read_song(path: str | Path, *, tracks: Sequence[int] | None = None) -> Song:
    """Read a MIDI file; `tracks` are counted from 0, None for all. Drums are left out.

    Raises `InputError` for what is not MIDI, has no notes, no such track, or counts time in frames.
    """
    path = regular_file(path, "a MIDI file (.mid)")
    with blaming(f"{path}: is not a MIDI file that can be read", Exception):
        file = mido.MidiFile(path)
    if file.type == 2 or not 0 < file.ticks_per_beat < 1 << 15:
        raise InputError(f"{path}: is of type {file.type}, expected type 0 or 1 with time in ticks per beat")
    names = tuple(track.name for track in file.tracks)
    chosen = range(len(names)) if tracks is None else tracks
    for track in chosen:
        if not 0 <= track < len(names):
            raise InputError(f"{path}: has no track {track}; tracks: {dict(enumerate(names))}")
    file.tracks = [track if i in chosen else _without_notes(track) for i, track in enumerate(file.tracks)]
    notes = sorted(_notes(file), key=lambda note: (note.start, note.key))
    if not notes:
        raise InputError(f"{path}: has no notes in {'it' if tracks is None else 'the chosen tracks'}")
    return Song(tuple(notes), names)


def _without_notes(track: Any) -> Any:
    """Return a track whose notes do nothing: its changes of tempo hold for all."""
    silent = mido.MidiTrack()
    for message in track:
        silent.append(mido.MetaMessage("text", time=message.time) if "note" in message.type else message)
    return silent


def _notes(messages: Iterable[Any]) -> list[Note]:
    """Return the notes of messages whose `time` is in s, since the one before; a key struck again ends its note."""
    notes: list[Note] = []
    sounding: dict[tuple[int, int], tuple[float, int]] = {}  # start and velocity, by channel and MIDI note
    now = 0.0

    def end(at: tuple[int, int]) -> None:
        start, velocity = sounding.pop(at)
        if now > start:
            notes.append(Note(at[1] - FIRST_NOTE, start, now, velocity))

    for message in messages:
        now += message.time
        if message.type not in ("note_on", "note_off") or message.channel == PERCUSSION:
            continue
        at = (message.channel, message.note)
        if at in sounding:
            end(at)
        if message.type == "note_on" and message.velocity > 0:
            sounding[at] = (now, message.velocity)
    for at in list(sounding):
        end(at)
    return notes


def transpose(song: Song, semitones: int) -> Song:
    """Return the same song, so many keys higher."""
    return replace(song, notes=tuple(replace(note, key=note.key + semitones) for note in song.notes))


def thin_out(song: Song, keys: Collection[int], voices: int) -> tuple[Song, tuple[Note, ...]]:
    """Return what can be played of a song on some keys, and the notes that are left out.

    Of more notes at a time than there are voices the highest is kept, then the lowest, then the hardest struck. A note
    that must make room while it sounds ends there.
    """
    dropped = [note for note in song.notes if note.key not in keys]
    left = [note for note in song.notes if note.key in keys]
    kept: list[Note] = []
    sounding: list[Note] = []
    for start, group in groupby(left, key=lambda note: note.start):
        kept += [note for note in sounding if note.end <= start]
        wanted = sorted([*(note for note in sounding if note.end > start), *group], key=lambda note: note.key)
        ranked = wanted[-1:] + wanted[:-1][:1] + sorted(wanted[1:-1], key=lambda note: -note.velocity)
        for note in ranked[voices:]:
            if note.start < start:
                kept.append(replace(note, end=start))
            else:
                dropped.append(note)
        sounding = ranked[:voices]
    played = sorted([*kept, *sounding], key=lambda note: (note.start, note.key))
    return replace(song, notes=tuple(played)), tuple(dropped)


def playable(song: Song, robot: RobotDescription) -> tuple[Song, tuple[Note, ...]]:
    """Return what a robot can play of a song: in its reach, a note a finger at a time; and the notes left out.

    It begins late enough for the hands to come over the keys. Of a robot without a piano the whole keyboard counts.
    """
    played, dropped = thin_out(song, _reach(robot), KEY_COUNT if robot.piano is None else len(robot.piano.fingers))
    wait = max(_LEAD_IN - min((note.start for note in played.notes), default=_LEAD_IN), 0.0)
    later = tuple(replace(note, start=note.start + wait, end=note.end + wait) for note in played.notes)
    return replace(song, notes=later), dropped


def _reach(robot: RobotDescription) -> Collection[int]:
    return range(KEY_COUNT) if robot.piano is None else robot.piano.keys


def named_song(
    name: str, robot: RobotDescription, folder: Path = Path(), what: str = "--song"
) -> tuple[Song, tuple[Note, ...]]:
    """Return what a robot can play of a sample song, or of a MIDI file in `folder`; and the notes left out.

    Raises `InputError`, which begins with `what`, if there is no such song, or none of its notes is within reach.
    """
    is_beside = name not in sample_songs() and is_file(folder / name)
    song, dropped = playable(read_song(folder / name if is_beside else song_path(name, what)), robot)
    if not song.notes:
        reach = f"{key_name(min(_reach(robot)))} to {key_name(max(_reach(robot)))}"
        whose = f"within the reach of '{robot.name}', {reach}; prepare --transpose moves them"
        raise InputError(f"{what}: none of the notes of '{name}' is {whose}")
    return song, dropped


def song_motion(song: Song, policy_dt: float, robot: RobotDescription) -> Motion:
    """Return the goals of a song as a motion, one row per policy step of `policy_dt` (s)."""
    return Motion(goals(song, policy_dt), (), policy_dt, task_type="piano", robot=robot.name)


def left_out(notes: Iterable[Note]) -> str:
    """Return the keys of notes from the lowest up, each with how often: `C2, G7 (3)`."""
    counts = sorted(Counter(note.key for note in notes).items())
    return ", ".join(f"{key_name(key)} ({count})" if count > 1 else key_name(key) for key, count in counts)


def goals(song: Song, policy_dt: float) -> Float32Array:
    """Return the keys to be held down, shape (F, 88), 0 or 1, a row every `policy_dt` s; the last row is all released.

    A note begins in the step nearest to its start and lasts for at least one. Before the same key is struck again it is
    released, as long as the note before keeps one step: a key that stays down cannot sound again.
    """
    table = np.zeros((round(song.seconds / policy_dt) + 2, KEY_COUNT), dtype=np.float32)
    released = max(round(_GAP / policy_dt), 1)
    following: dict[int, int] = {}
    for note in reversed(song.notes):
        first = round(note.start / policy_dt)
        end = max(round(note.end / policy_dt), first + 1)
        if note.key in following:
            end = max(min(end, following[note.key] - released), first + 1)
        table[first:end, note.key] = 1.0
        following[note.key] = first
    return table[: int(np.flatnonzero(table.any(axis=1)).max(initial=-1)) + 2]
