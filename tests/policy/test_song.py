"""MIDI files become notes, and notes the keys to be held down."""

import mido
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.policy.song import Note, Song, load_song, playable, read_notes, song_motion
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


def spans(notes):
    return [(note.key, round(note.start, 6), round(note.end, 6)) for note in notes]


def test_notes_follow_every_change_of_tempo(write):
    tempo = [MetaMessage("set_tempo", tempo=1_000_000, time=BEAT), MetaMessage("set_tempo", tempo=250_000, time=BEAT)]
    melody = [*struck(60, BEAT), *struck(62, BEAT), *struck(64, BEAT)]
    assert spans(read_notes(write(tempo, melody))) == [(39, 0.0, 0.5), (41, 0.5, 1.5), (43, 1.5, 1.75)]


def test_a_note_that_is_struck_again_ends_and_drums_are_left_out(write):
    track = [
        Message("note_on", note=60),
        Message("note_on", note=60, time=BEAT),
        Message("note_on", note=60, velocity=0, time=BEAT),
        *(message.copy(channel=9) for message in struck(35, BEAT)),
        Message("note_on", note=64),
        MetaMessage("end_of_track", time=BEAT),
    ]
    assert spans(read_notes(write(track))) == [(39, 0.0, 0.5), (39, 0.5, 1.0), (43, 1.5, 2.0)], (
        "the last is not released"
    )


def test_a_file_that_is_no_song_is_one_line(write, tmp_path):
    for data, reason in {
        b"MThd\x00\x00": "is not a MIDI file that can be read: ",
        write([MetaMessage("track_name", name="a")]).read_bytes(): "has no notes",
        write(struck(60, 1), type=2).read_bytes(): "type 2",
    }.items():
        (tmp_path / "bad.mid").write_bytes(data)
        with pytest.raises(InputError, match=rf"bad\.mid: .*{reason}"):
            read_notes(tmp_path / "bad.mid")


def test_a_key_is_released_before_it_is_struck_again():
    song = Song((Note(3, 0.0, 0.2), Note(3, 0.2, 0.4), Note(3, 0.4, 0.44)), ())
    assert song_motion(song, 0.04, load_robot("lite")).frames[:, 3].tolist() == [1, 1, 1, 0, 0, 1, 1, 1, 0, 0, 1, 0]


def test_what_a_robot_can_play_begins_when_its_hands_are_there():
    song = playable(
        [Note(39, 0.5, 1.5), Note(41, 0.5, 1.5), Note(43, 1.0, 2.0), Note(2, 2.0, 3.0)], load_robot("lite_piano").piano
    )
    assert spans(song.notes) == [(39, 1.0, 2.0), (41, 1.0, 2.0)], "two fingers, the highest keys first"
    assert song.names_left_out == "B0, E4"
    with pytest.raises(InputError, match="robot 'lite' has no piano"):
        load_song("twinkle", load_robot("lite"))
