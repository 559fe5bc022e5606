"""Random songs: to train a piano policy on, and, from seeds of their own, to test it on songs that it never saw."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from humanoid_sim.assets import sample_songs, song_path
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.files import is_file
from humanoid_sim.policy.song import LEAD_IN, Note, Song, playable, read_song
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.piano import KEY_COUNT

NOTES_PER_SECOND = 3
"""Most notes of a song, all voices together, that begin within any one second."""
APART = 5
"""Semitones between the keys of two voices at least: hands need room."""

_SCALES = ((0, 2, 4, 5, 7, 9, 11), (0, 2, 3, 5, 7, 8, 10), (0, 2, 4, 7, 9), tuple(range(12)))
"""Pitch classes from the tonic: major, minor, pentatonic, all."""
_SHORTEST = 0.12
"""s that a note lasts at least."""
_RELEASED = 0.08
"""s between two notes of a voice, at least: one finger leaves a key before it strikes the next."""
_WINDOW = 1.0 - 1e-9
"""s: notes that begin exactly one second apart are not within it."""
_RANDOM, _DIGITS = "random:", 9
_HELD_OUT = 88
"""Keeps songs to test on apart from those to train on, whatever the seed."""


def random_song(
    rng: np.random.Generator,
    hands: Sequence[Sequence[int]],
    *,
    seconds: float = 20.0,
    notes_per_second: int = NOTES_PER_SECOND,
    lead_in: float = LEAD_IN,
) -> Song:
    """Return a song with one voice for each hand; notes of a voice do not overlap, and voices do not cross.

    Each voice keeps to a scale. It walks, leaps, repeats and rests; notes are long or short, together or by turns.
    Raises `FieldError` if a hand has no keys, or a number is out of its range.

    Args:
        hands: the keys of each voice, from the lowest voice up.
        seconds: until the last note's end, at most.
        notes_per_second: of all voices together, within any second.
        lead_in: s before the first note.
    """
    for i, keys in enumerate(hands):
        if not keys or not all(0 <= key < KEY_COUNT for key in keys):
            raise FieldError(f"hands[{i}]: is {list(keys)}, expected keys of 0 to {KEY_COUNT - 1}")
    if not hands or notes_per_second < 1 or not seconds > lead_in + 1.0:
        raise FieldError(
            f"random_song: {len(hands)} hands, {notes_per_second} notes a second and {seconds} s, expected at least "
            f"one of each, and {lead_in + 1.0:g} s"
        )
    beat = rng.uniform(1.0, 2.0) / notes_per_second
    scale, tonic = _SCALES[rng.integers(len(_SCALES))], rng.integers(12)
    voices = []
    for track, keys in enumerate(hands):
        chosen = sorted(key for key in keys if (key - int(tonic)) % 12 in scale)
        usual = chosen if len(chosen) >= 3 else sorted(keys)  # too few to move
        voices.append(_voice(rng, sorted(keys), usual, beat, lead_in, seconds, track))
    kept: list[Note] = []
    for note in sorted((note for voice in voices for note in voice), key=lambda note: (note.start, rng.random())):
        recent = [other for other in kept if note.start - other.start < _WINDOW]
        if len(recent) < notes_per_second and all(_has_room(note, other) for other in kept):
            kept.append(note)
    names = tuple(f"voice {i + 1}" for i in range(len(hands)))
    if not kept:  # every voice rested: one note, so that there is a song
        key = int(rng.choice(np.asarray(hands[0])))
        kept.append(Note(key, lead_in, lead_in + beat, track=0))
    return Song(tuple(sorted(kept, key=lambda note: (note.start, note.key))), names)


def held_out_songs(hands: Sequence[Sequence[int]], count: int, seed: int = 0) -> list[Song]:
    """Songs that no training with `random_song` sees, whatever its seed."""
    return [_held_out(hands, i, seed) for i in range(count)]


def named_song(name: str, robot: RobotDescription, folder: Path = Path(), what: str = "song") -> Song:
    """Return the song of `choose_song`, which has a note at least; `what` is what messages call it.

    Raises `InputError` if there is no such song, it cannot be read, or none of its notes is within reach.
    """
    try:
        song, _ = choose_song(name, robot, folder)
    except InputError as error:  # which names the option of `play`
        raise InputError(str(error).replace("--song", what, 1)) from None
    if not song.notes:
        raise InputError(f"{what}: none of the notes of '{name}' is within the reach of '{robot.name}'")
    return song


def choose_song(name: str, robot: RobotDescription, folder: Path = Path()) -> tuple[Song, tuple[Note, ...]]:
    """Return what a robot can play of a sample song, of a MIDI file, or of `random:N`, the N-th of `held_out_songs`.

    Raises `InputError` naming the option --song: there is no such song, or it cannot be read.

    Args:
        robot: with a piano.
        folder: that the path of a file is relative to.

    Returns:
        The song, and the notes that are left out of it.
    """
    if is_generated(name):
        number = name.removeprefix(_RANDOM)
        if not (number.isascii() and number.isdigit() and len(number) <= _DIGITS):
            raise InputError(f"--song: is '{name}', expected {_RANDOM}N, N a whole number of at most {_DIGITS} digits")
        if robot.piano is None:
            raise InputError(f"--song: is '{name}', but '{robot.name}' has no piano, whose keys it would be made for")
        return _held_out(robot.piano.hands, int(number), 0), ()
    beside = folder / name
    is_beside = name not in sample_songs() and is_file(beside)
    return playable(read_song(beside if is_beside else song_path(name)), robot)


def is_generated(name: str) -> bool:
    """Return whether a name of a song is of the form `random:N`, and so no file's."""
    return name.startswith(_RANDOM)


def _held_out(hands: Sequence[Sequence[int]], number: int, seed: int) -> Song:
    return random_song(np.random.default_rng([_HELD_OUT, seed, number]), hands)


def _voice(
    rng: np.random.Generator,
    reach: Sequence[int],
    keys: Sequence[int],
    beat: float,
    begin: float,
    end: float,
    track: int,
) -> list[Note]:
    """Return the notes of one voice; `reach` is all that its hand has, for the notes that leave the scale."""
    rest, repeat, leap = rng.uniform(0.0, 0.3), rng.uniform(0.0, 0.4), rng.uniform(0.0, 0.3)
    held = rng.uniform(0.4, 1.0)
    lengths, weights = np.array([1.0, 2.0, 3.0, 4.0]), rng.dirichlet([3.0, 2.0, 0.6, 0.6])
    place = int(rng.integers(len(keys)))
    time = begin + beat * float(rng.choice([0.0, 0.0, 1.0, 2.0]))
    notes: list[Note] = []
    while time + beat <= end:
        length = min(float(rng.choice(lengths, p=weights)) * beat, end - time)
        if rng.random() >= rest:
            if rng.random() < leap:
                place = int(rng.integers(len(keys)))
            elif rng.random() >= repeat:
                place = int(np.clip(place + rng.choice([-2, -1, -1, 1, 1, 2]), 0, len(keys) - 1))
            key = int(rng.choice(np.asarray(reach))) if rng.random() < 0.05 else keys[place]
            sounding = max(_SHORTEST, min(held * length * rng.uniform(0.8, 1.0), length - _RELEASED))
            notes.append(Note(key, time, time + sounding, int(rng.integers(40, 100)), track))
        time += length
    return notes


def _has_room(note: Note, other: Note) -> bool:
    """Tell whether two notes of different voices leave their hands room, also where one ends as the other begins."""
    if note.track == other.track or note.start >= other.end + _RELEASED:
        return True
    high, low = (note, other) if note.track > other.track else (other, note)
    return high.key - low.key >= APART
