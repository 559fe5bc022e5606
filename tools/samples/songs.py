"""The sample songs: tunes that belong to nobody, and exercises, written down here. `tools.samples songs` writes them.

Two voices each, one for each hand of a robot that plays with one finger a hand: the upper first. At most three notes
begin within a second.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from types import MappingProxyType

import mido
import numpy as np

from humanoid_sim.errors import InputError
from humanoid_sim.files import whole_file
from humanoid_sim.policy.song import Song, key_number
from humanoid_sim.robots.piano import FIRST_NOTE

__all__ = ["SONGS", "Tune", "song_bytes", "write_songs"]

_TICKS = 480
"""Per beat."""
_DETACHED = 1.0 / 8.0
"""Part of a beat by which a note ends before the next one begins: a finger has to go there."""
_VELOCITY = 72
_VOICES = ("upper voice", "lower voice")


@dataclass(frozen=True, slots=True)
class Tune:
    """Two voices in text: `C4` lasts a beat, `C4:1.5` as many, `R` is a rest; bars are for the reader."""

    title: str
    tempo: float
    """Beats per minute."""
    upper: str
    lower: str


_ODE_UPPER = (
    "E5 E5 F5 G5 | G5 F5 E5 D5 | C5 C5 D5 E5 | E5:1.5 D5:.5 D5:2 |"
    "E5 E5 F5 G5 | G5 F5 E5 D5 | C5 C5 D5 E5 | D5:1.5 C5:.5 C5:2 |"
    "D5 D5 E5 C5 | D5 E5:.5 F5:.5 E5 C5 | D5 E5:.5 F5:.5 E5 D5 | C5 D5 G4:2 |"
    "E5 E5 F5 G5 | G5 F5 E5 D5 | C5 C5 D5 E5 | D5:1.5 C5:.5 C5:2"
)
_ODE_LOWER = (
    "C3:4 | G3:2 G2:2 | C3:4 | G3:4 | C3:4 | G3:2 G2:2 | C3:4 | G3:2 C3:2 |"
    "G3:4 | G3:4 | G3:4 | A3:2 G3:2 | C3:4 | G3:2 G2:2 | C3:4 | G3:2 C3:2"
)
_FRERE = (
    "C D E C | C D E C | E F G:2 | E F G:2 | G:.5 A:.5 G:.5 F:.5 E C | G:.5 A:.5 G:.5 F:.5 E C | C ,G C:2 | C ,G C:2"
)
_GREEN_UPPER = (
    "A4 | C5:2 D5 | E5:1.5 F5:.5 E5 | D5:2 B4 | G4:1.5 A4:.5 B4 | C5:2 A4 | A4:1.5 G#4:.5 A4 | B4:2 G#4 | E4:2 A4 |"
    "C5:2 D5 | E5:1.5 F5:.5 E5 | D5:2 B4 | G4:1.5 A4:.5 B4 | C5:1.5 B4:.5 A4 | G#4:1.5 F#4:.5 G#4 | A4:3 | A4:3 |"
    "G5:3 | G5:1.5 F#5:.5 E5 | D5:2 B4 | G4:1.5 A4:.5 B4 | C5:2 A4 | A4:1.5 G#4:.5 A4 | B4:2 G#4 | E4:3 |"
    "G5:3 | G5:1.5 F#5:.5 E5 | D5:2 B4 | G4:1.5 A4:.5 B4 | C5:1.5 B4:.5 A4 | G#4:1.5 F#4:.5 G#4 | A4:3 | A4:3"
)
_GREEN_LOWER = (
    "R | A3:3 | A3:3 | G3:3 | E3:3 | A3:3 | F3:3 | E3:3 | E3:3 |"
    "A3:3 | A3:3 | G3:3 | E3:3 | A3:3 | E3:3 | A3:3 | A2:3 |"
    "C3:3 | C3:3 | G3:3 | E3:3 | A3:3 | F3:3 | E3:3 | E3:3 | C3:3 | C3:3 | G3:3 | E3:3 | A3:3 | E3:3 | A3:3 | A2:3"
)
_MINUET_UPPER = (
    "D5 G4:.5 A4:.5 B4:.5 C5:.5 | D5 G4 G4 | E5 C5:.5 D5:.5 E5:.5 F#5:.5 | G5 G4 G4 |"
    "C5 D5:.5 C5:.5 B4:.5 A4:.5 | B4 C5:.5 B4:.5 A4:.5 G4:.5 | F#4 G4:.5 A4:.5 B4:.5 G4:.5 | A4:3 |"
    "D5 G4:.5 A4:.5 B4:.5 C5:.5 | D5 G4 G4 | E5 C5:.5 D5:.5 E5:.5 F#5:.5 | G5 G4 G4 |"
    "C5 D5:.5 C5:.5 B4:.5 A4:.5 | B4 C5:.5 B4:.5 A4:.5 G4:.5 | A4 B4:.5 A4:.5 G4:.5 F#4:.5 | G4:3"
)
_MINUET_LOWER = (
    "G2:2 A2 | B2:3 | C3:3 | B2:3 | A2:3 | G2:3 | D3 B2 G2 | D3 D3:.5 C3:.5 B2:.5 A2:.5 |"
    "B2:2 A2 | G2 B2 G2 | C3:3 | B2 C3:.5 B2:.5 A2:.5 G2:.5 | A2:2 F#2 | G2:2 B2 | C3 D3 D3 | G2:3"
)
_TWINKLE = "{0} | {1} | {0}".format(
    "C5 C5 G5 G5 | A5 A5 G5:2 | F5 F5 E5 E5 | D5 D5 C5:2", "G5 G5 F5 F5 | E5 E5 D5:2 | G5 G5 F5 F5 | E5 E5 D5:2"
)
_TWINKLE_LOWER = "{0} | {1} | {0}".format(
    "C3:2 E3:2 | F3:2 E3:2 | D3:2 C3:2 | G3:2 C3:2", "E3:2 D3:2 | C3:2 G2:2 | E3:2 D3:2 | C3:2 G2:2"
)


def _at_octave(text: str, octave: int) -> str:
    """Return a tune whose notes have no octaves, `,` before one that is an octave lower."""
    words = []
    for word in text.split():
        name, colon, beats = word.partition(":")
        own = octave - 1 if name.startswith(",") else octave
        words.append(word if name in ("|", "R") else f"{name.lstrip(',')}{own}{colon}{beats}")
    return " ".join(words)


SONGS: Mapping[str, Tune] = MappingProxyType(
    {
        "ode_to_joy": Tune("Ode to Joy, after L. van Beethoven (1824)", 84, _ODE_UPPER, _ODE_LOWER),
        "frere_jacques": Tune(
            "Frère Jacques, a canon (18th century)", 60, _at_octave(_FRERE, 5), f"R:8 | {_at_octave(_FRERE, 3)}"
        ),
        "twinkle": Tune("Ah ! vous dirai-je, maman (18th century)", 88, _TWINKLE, _TWINKLE_LOWER),
        "greensleeves": Tune("Greensleeves (16th century)", 84, _GREEN_UPPER, _GREEN_LOWER),
        "minuet_in_g": Tune("Minuet in G, BWV Anh. 114, C. Petzold (1725)", 58, _MINUET_UPPER, _MINUET_LOWER),
        "five_fingers": Tune(
            "Exercise: five neighbouring keys",
            80,
            "C5 D5 E5 F5 | G5 F5 E5 D5 | C5 E5 D5 F5 | E5 G5 F5 D5 | C5:4",
            "C3:2 E3:2 | G3:2 E3:2 | C3:2 D3:2 | E3:2 F3:2 | C3:4",
        ),
        "contrary": Tune(
            "Exercise: scales in contrary motion",
            60,
            "C5 D5 E5 F5 G5 A5 B5 C6 | C6 B5 A5 G5 F5 E5 D5 C5:2",
            "C4 B3 A3 G3 F3 E3 D3 C3 | C3 D3 E3 F3 G3 A3 B3 C4:2",
        ),
        "leaps": Tune(
            "Exercise: leaps, the hands by turns",
            96,
            "C5 R G5 R C6 R G5 R | C5 R A5 R E5 R C6 R | G5:2 C5:2 E5:4",
            "R C3 R G3 R E3 R C3 | R F3 R C3 R A3 R C3 | G3:2 E3:2 C3:4",
        ),
        "repeats": Tune(
            "Exercise: keys that are struck again",
            108,
            "C5 C5 C5 E5 E5 E5 | G5 G5 G5 E5:3 | D5 D5 B4 B4 C5:2",
            "C3:3 C3:3 | G3:3 C3:3 | G3:2 G3:2 C3:2",
        ),
        "black_keys": Tune(
            "Exercise: black keys",
            84,
            "F#4 G#4 A#4 C#5 | D#5 C#5 A#4 G#4 | F#5 D#5 C#5 A#4 | G#4 A#4 F#4:2",
            "F#2:2 C#3:2 | D#3:2 C#3:2 | A#2:2 F#2:2 | C#3:2 F#2:2",
        ),
    }
)
"""By the name of their file."""


def song_bytes(tune: Tune) -> bytes:
    """Write a tune as a Standard MIDI File of type 1: title and tempo, then a track per voice. The same each time."""
    file = mido.MidiFile(type=1, ticks_per_beat=_TICKS)
    head = mido.MidiTrack([mido.MetaMessage("track_name", name=tune.title)])
    head.append(mido.MetaMessage("set_tempo", tempo=round(6e7 / tune.tempo)))
    file.tracks.append(head)
    for channel, (name, text) in enumerate(zip(_VOICES, (tune.upper, tune.lower), strict=True)):
        track = mido.MidiTrack([mido.MetaMessage("track_name", name=name)])
        waited = 0
        for key, ticks in _notes(text):
            if key is None:
                waited += ticks
                continue
            gap = min(round(_DETACHED * _TICKS), ticks // 2)
            sound = {"note": key + FIRST_NOTE, "velocity": _VELOCITY, "channel": channel}
            track.append(mido.Message("note_on", time=waited, **sound))
            track.append(mido.Message("note_off", time=ticks - gap, **sound))
            waited = gap
        file.tracks.append(track)
    content = BytesIO()
    file.save(file=content)
    return content.getvalue()


def _notes(text: str) -> list[tuple[int | None, int]]:
    """Keys, None for a rest, and their lengths in ticks."""
    found = []
    for word in text.replace("|", " ").split():
        name, _, beats = word.partition(":")
        key = None if name == "R" else key_number(name)
        if key is None and name != "R":
            raise ValueError(f"{word} is not a note")
        found.append((key, round(float(beats or 1.0) * _TICKS)))
    return found


def write_songs(folder: Path) -> None:
    """Write every sample song as a .mid file; the folder is made if it is missing.

    Raises `InputError` if it cannot be written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made a folder: {error.strerror}") from None
    for name, tune in SONGS.items():
        with whole_file(folder / f"{name}.mid") as file:
            file.write(song_bytes(tune))
        print(f"{folder / name}.mid: {tune.title}")


def most_onsets(song: Song, window: float = 1.0) -> int:
    """Most notes that begin within any `window` (s)."""
    starts = np.sort([note.start for note in song.notes])
    ends = np.searchsorted(starts, starts + window - 1e-9)
    return int((ends - np.arange(len(starts))).max(initial=0))
