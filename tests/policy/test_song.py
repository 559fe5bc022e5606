"""MIDI files become notes, and notes the keys to be held down."""

import mido
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.policy.song import Note, Song, goals, read_song, thin_out, transpose

Message, MetaMessage = mido.Message, mido.MetaMessage
BEAT = 480
"""Ticks; half a second at the tempo that a file has without one."""


def write(path, *tracks, **options):
    file = mido.MidiFile(ticks_per_beat=BEAT, **options)
    file.tracks.extend(mido.MidiTrack(track) for track in tracks)
    file.save(path)
    return path


def struck(note, ticks, wait=0, **options):
    return [Message("note_on", note=note, time=wait, **options), Message("note_off", note=note, time=ticks)]


def spans(song):
    return [(note.key, round(note.start, 6), round(note.end, 6)) for note in song.notes]


def test_notes_follow_every_change_of_tempo(tmp_path):
    tempo = [MetaMessage("set_tempo", tempo=1_000_000, time=BEAT), MetaMessage("set_tempo", tempo=250_000, time=BEAT)]
    melody = [MetaMessage("track_name", name="right"), *struck(60, BEAT), *struck(62, BEAT), *struck(64, BEAT)]
    song = read_song(write(tmp_path / "x.mid", tempo, melody))
    assert spans(song) == [(39, 0.0, 0.5), (41, 0.5, 1.5), (43, 1.5, 1.75)]
    assert (song.tracks, song.seconds) == (("", "right"), 1.75)


def test_a_note_that_is_struck_again_ends_and_one_without_an_end_lasts_to_the_end(tmp_path):
    track = [
        Message("note_on", note=60, velocity=50),
        Message("note_on", note=60, velocity=90, time=BEAT),
        Message("note_on", note=60, velocity=0, time=BEAT),
        Message("note_on", note=67, time=BEAT),
        Message("note_on", note=35, channel=9, time=BEAT),
        MetaMessage("end_of_track", time=BEAT),
    ]
    song = read_song(write(tmp_path / "x.mid", track))
    assert spans(song) == [(39, 0.0, 0.5), (39, 0.5, 1.0), (46, 1.5, 2.5)]
    assert [note.velocity for note in song.notes] == [50, 90, 64]


def test_the_pedal_holds_notes_if_asked(tmp_path):
    pedal = {"control": 64}
    track = [
        Message("control_change", value=127, **pedal),
        *struck(60, BEAT),
        *struck(60, BEAT),
        Message("control_change", value=0, time=BEAT, **pedal),
    ]
    path = write(tmp_path / "x.mid", track)
    assert spans(read_song(path)) == [(39, 0.0, 0.5), (39, 0.5, 1.0)]
    assert spans(read_song(path, sustain=True)) == [(39, 0.0, 0.5), (39, 0.5, 1.5)]


def test_tracks_are_chosen(tmp_path):
    path = write(tmp_path / "x.mid", struck(60, BEAT), struck(48, BEAT))
    assert spans(read_song(path, tracks=[1])) == [(27, 0.0, 0.5)]
    with pytest.raises(InputError, match=r"x\.mid: has no track 2; tracks: 0 '', 1 ''"):
        read_song(path, tracks=[2])


def test_what_is_no_song_is_one_line(tmp_path):
    broken = tmp_path / "broken.mid"
    broken.write_bytes(b"MThd\x00\x00\x00\x06\x00\x01\x00\x01\x01\xe0MTrk\xff\xff\xff\xff\x00")
    with pytest.raises(InputError, match=r"broken\.mid: is not a MIDI file that can be read: "):
        read_song(broken)
    with pytest.raises(InputError, match=r"empty\.mid: has no notes in it"):
        read_song(write(tmp_path / "empty.mid", [MetaMessage("track_name", name="a")]))
    with pytest.raises(InputError, match=r"two\.mid: is of type 2"):
        read_song(write(tmp_path / "two.mid", struck(60, 1), type=2))
    frames = bytearray(write(tmp_path / "x.mid", struck(60, 1)).read_bytes())
    frames[12:14] = b"\xe7\x28"
    (tmp_path / "frames.mid").write_bytes(frames)
    with pytest.raises(InputError, match=r"frames\.mid: counts time in frames"):
        read_song(tmp_path / "frames.mid")


def test_a_trill_too_fast_for_a_gap_keeps_a_step_each():
    song = Song(tuple(Note(3, 0.04 * i, 0.04 * (i + 1)) for i in range(3)), ())
    assert goals(song, 0.02, gap=0.5)[:, 3].tolist() == [1, 0, 1, 0, 1, 1, 0]


def test_voices_and_reach():
    chord = [Note(key, 1.0, 2.0, velocity) for key, velocity in ((30, 10), (33, 90), (36, 20), (40, 10))]
    song = Song((Note(20, 0.0, 3.0), Note(60, 0.0, 1.0), *chord), ())
    played, dropped = thin_out(song, range(20, 50), voices=3)
    assert [(note.key, note.start, note.end) for note in played.notes] == [
        (20, 0.0, 3.0),
        (33, 1.0, 2.0),
        (40, 1.0, 2.0),
    ]
    assert [note.key for note in dropped] == [60, 36, 30]
    one, _ = thin_out(song, range(20, 50), voices=1)
    assert [(note.key, note.start, note.end) for note in one.notes] == [(20, 0.0, 1.0), (40, 1.0, 2.0)]
    everything, nothing = thin_out(transpose(song, 2), range(22, 63))
    assert ([note.key for note in everything.notes][:2], nothing) == ([22, 62], ())
