"""Songs as goals for a piano's keys: the notes of a MIDI file, as rows of 0 and 1 per policy step."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mido
import numpy as np

from humanoid_sim.assets import shipped, song_path
from humanoid_sim.errors import InputError, blaming
from humanoid_sim.files import regular_file
from humanoid_sim.policy.motion import Motion
from humanoid_sim.robots.piano import FIRST_NOTE, KEY_COUNT
from humanoid_sim.robots.schema import PianoSettings, RobotDescription

PERCUSSION = 9  # channel whose notes are drums, counted from 0
_LEAD_IN = 1.0  # s before the first note, in which a robot's hands come over the keys
_GAP = 0.06  # s for which a key is released before it is struck again
_NAMES = ("C", "C#", "D", "D#", "E", "F", "F#", "G", "G#", "A", "A#", "B")


@dataclass(frozen=True, slots=True)
class Note:
    """One note."""

    key: int  # 0 (A0) to 87 (C8), or beyond where the piano has no such key
    start: float  # s
    end: float  # s


@dataclass(frozen=True, slots=True)
class Song:
    """What a robot can play of a song."""

    notes: tuple[Note, ...]  # in order of their start
    left_out: tuple[Note, ...]

    @property
    def names_left_out(self) -> str:
        """The keys of the notes that are left out, from the lowest up."""
        return ", ".join(key_name(key) for key in sorted({note.key for note in self.left_out}))


def key_name(key: int) -> str:
    """Return such as `C4` for key 39, middle C."""
    note = key + FIRST_NOTE
    return f"{_NAMES[note % 12]}{note // 12 - 1}"


def load_song(name: str, robot: RobotDescription, folder: Path = Path(), what: str = "--song") -> Song:
    """Return what a robot can play of a sample song, or of a MIDI file in `folder`; `what` begins a refusal."""
    if robot.piano is None:
        raise InputError(f"{what}: robot '{robot.name}' has no piano; lite_piano has one")
    is_beside = name not in shipped("songs") and os.path.isfile(folder / name)
    song = playable(read_notes(folder / name if is_beside else song_path(name, what)), robot.piano)
    if not song.notes:
        raise InputError(f"{what}: '{name}' has no note that '{robot.name}' can reach: {song.names_left_out}")
    return song


def read_notes(path: Path) -> list[Note]:
    """Read the notes of a MIDI file, without drums, in order of their start. Raises `InputError`."""
    regular_file(path, "a MIDI file (.mid)")
    with blaming(f"{path}: is not a MIDI file that can be read", Exception):
        notes = sorted(_notes(mido.MidiFile(path)), key=lambda note: (note.start, note.key))
    if not notes:
        raise InputError(f"{path}: has no notes")
    return notes


def _notes(messages: Iterable[Any]) -> list[Note]:
    notes: list[Note] = []
    starts: dict[tuple[int, int], float] = {}  # by channel and MIDI note
    now = 0.0
    for message in messages:
        now += message.time
        if message.type not in ("note_on", "note_off") or message.channel == PERCUSSION:
            continue
        at = (message.channel, message.note)
        start = starts.pop(at, now)
        if start < now:
            notes.append(Note(message.note - FIRST_NOTE, start, now))
        if message.type == "note_on" and message.velocity > 0:
            starts[at] = now
    held = [Note(note - FIRST_NOTE, start, now) for (_, note), start in starts.items() if start < now]
    return notes + held  # to the end, where nothing releases them


def playable(notes: Iterable[Note], piano: PianoSettings) -> Song:
    """Return the notes in a robot's reach, no more at a time than it has fingers, after time to come over the keys."""
    reach, fingers = piano.keys, len(piano.fingers)
    played: list[Note] = []
    left_out: list[Note] = []
    for note in sorted(notes, key=lambda note: (note.start, -note.key)):
        sounding = sum(other.end > note.start for other in played)
        can_play = note.key in reach and sounding < fingers
        (played if can_play else left_out).append(note)
    wait = max(_LEAD_IN - min((note.start for note in played), default=_LEAD_IN), 0.0)
    later = [Note(note.key, note.start + wait, note.end + wait) for note in played]
    return Song(tuple(sorted(later, key=lambda note: (note.start, note.key))), tuple(left_out))


def song_motion(song: Song, policy_dt: float, robot: RobotDescription) -> Motion:
    """Return the keys to be held down, (F, 88), 0 or 1, a row every `policy_dt` s; in the last row all are released."""
    seconds = max(note.end for note in song.notes)
    table = np.zeros((round(seconds / policy_dt) + 1, KEY_COUNT), dtype=np.float32)
    gap = max(round(_GAP / policy_dt), 1)
    for note in song.notes:
        first = round(note.start / policy_dt)
        table[max(first - gap, 0) : first, note.key] = 0.0  # a key that stays down cannot sound again
        table[first : max(round(note.end / policy_dt), first + 1), note.key] = 1.0
    return Motion(table, (), policy_dt, task_type="piano", robot=robot.name)
