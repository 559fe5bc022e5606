"""MIDI files become notes, and notes the keys to be held down."""

import mido
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.policy.song import Note, Song, goals, playable, read_song, thin_out, transpose
from humanoid_sim.robots.description import load_robot

Message, MetaMessage = mido.Message, mido.MetaMessage
BEAT = 480
"""Ticks; half a second at the tempo that a file has without one."""


@pytest.fixture
def write(tmp_path):
    def save(*tracks, **options):
        file = mido.MidiFile(ticks_per_beat=BEAT, **options)
        file.tracks.extend(mido.MidiTrack(track) for track in tracks)
        file.save(tmp_path / "x.mid")
        return tmp_path / "x.mid"

    return save


def struck(note, ticks):
    return [Message("note_on", note=note), Message("note_off", note=note, time=ticks)]


def spans(song):
    return [(note.key, round(note.start, 6), round(note.end, 6)) for note in song.notes]


def test_notes_follow_every_change_of_tempo(write):
    tempo = [MetaMessage("set_tempo", tempo=1_000_000, time=BEAT), MetaMessage("set_tempo", tempo=250_000, time=BEAT)]
    melody = [MetaMessage("track_name", name="right"), *struck(60, BEAT), *struck(62, BEAT), *struck(64, BEAT)]
    song = read_song(write(tempo, melody))
    assert spans(song) == [(39, 0.0, 0.5), (41, 0.5, 1.5), (43, 1.5, 1.75)]
    assert song.tracks == ("", "right")


def test_a_note_that_is_struck_again_ends_and_one_without_an_end_lasts_to_the_end(write):
    track = [
        Message("note_on", note=60, velocity=50),
        Message("note_on", note=60, velocity=90, time=BEAT),
        Message("note_on", note=60, velocity=0, time=BEAT),
        Message("note_on", note=67, time=BEAT),
        Message("note_on", note=35, channel=9, time=BEAT),  # a drum
        MetaMessage("end_of_track", time=BEAT),
    ]
    song = read_song(write(track))
    assert spans(song) == [(39, 0.0, 0.5), (39, 0.5, 1.0), (46, 1.5, 2.5)]
    assert [note.velocity for note in song.notes] == [50, 90, 64]


def test_tracks_are_chosen(write):
    path = write(struck(60, BEAT), struck(48, BEAT))
    assert spans(read_song(path, tracks=[1])) == [(27, 0.0, 0.5)]
    with pytest.raises(InputError, match=r"x\.mid: has no track 2; tracks: "):
        read_song(path, tracks=[2])


def test_a_file_that_is_no_song_is_one_line(write, tmp_path):
    frames = bytearray(write(struck(60, 1)).read_bytes())
    frames[12:14] = b"\xe7\x28"
    broken = b"MThd\x00\x00\x00\x06\x00\x01\x00\x01\x01\xe0MTrk\xff\xff\xff\xff\x00"
    for data, reason in {
        broken: "is not a MIDI file that can be read: ",
        bytes(frames): "is of type 1, expected type 0 or 1 with time in ticks",
        write([MetaMessage("track_name", name="a")]).read_bytes(): "has no notes in it",
        write(struck(60, 1), type=2).read_bytes(): "is of type 2",
    }.items():
        (tmp_path / "bad.mid").write_bytes(data)
        with pytest.raises(InputError, match=rf"bad\.mid: {reason}"):
            read_song(tmp_path / "bad.mid")


def test_a_trill_too_fast_for_a_gap_keeps_a_step_each():
    song = Song(tuple(Note(3, 0.04 * i, 0.04 * (i + 1)) for i in range(3)), ())
    assert goals(song, 0.02)[:, 3].tolist() == [1, 0, 1, 0, 1, 1, 0]


def test_voices_and_reach():
    chord = [Note(key, 1.0, 2.0, velocity) for key, velocity in ((30, 10), (33, 90), (36, 20), (40, 10))]
    song = Song((Note(20, 0.0, 3.0), Note(60, 0.0, 1.0), *chord), ())
    played, dropped = thin_out(song, range(20, 50), voices=3)
    assert spans(played) == [(20, 0.0, 3.0), (33, 1.0, 2.0), (40, 1.0, 2.0)]
    assert [note.key for note in dropped] == [60, 36, 30]
    one, _ = thin_out(song, range(20, 50), voices=1)
    assert spans(one) == [(20, 0.0, 1.0), (40, 1.0, 2.0)]
    everything, nothing = thin_out(transpose(song, 2), range(22, 63), voices=10)
    assert ([note.key for note in everything.notes][:2], nothing) == ([22, 62], ())


def test_without_a_piano_the_whole_keyboard_counts():
    song = Song((Note(-1, 0.0, 1.0), Note(87, 2.0, 3.0), Note(88, 2.0, 3.0)), ())
    played, dropped = playable(song, load_robot("lite"))
    assert (spans(played), [note.key for note in dropped]) == ([(87, 2.0, 3.0)], [-1, 88])
