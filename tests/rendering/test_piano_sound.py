"""What is heard is what was pressed, when it was pressed, and nothing else."""

import wave
from io import BytesIO

import numpy as np
import pytest

from humanoid_sim.rendering.piano_sound import RATE, PianoSound, Stroke, frequency, strokes_between, tone, write_wav


def heard(strokes, seconds, pieces=1):
    sound = PianoSound()
    parts = []
    for i in range(pieces):
        end = seconds * (i + 1) / pieces
        sound.strike([stroke for stroke in strokes if end - seconds / pieces <= stroke.time < end])
        parts.append(sound.until(end))
    return np.concatenate(parts)


def pitch(samples, begin, end, low=20.0):
    """Hz of the strongest partial."""
    part = samples[round(begin * RATE) : round(end * RATE)]
    spectrum = np.abs(np.fft.rfft(part * np.hanning(len(part)), 1 << 17))
    hertz = np.fft.rfftfreq(1 << 17, 1 / RATE)
    return float(hertz[np.argmax(np.where(hertz >= low, spectrum, 0.0))])


def test_keys_have_their_pitch():
    assert [round(frequency(key), 2) for key in (0, 39, 48, 87)] == [27.5, 261.63, 440.0, 4186.01]


@pytest.mark.parametrize("key", [15, 27, 39, 51, 63, 87])
def test_the_strongest_partial_is_the_fundamental(key):
    assert pitch(tone(key), 0.05, 0.5) == pytest.approx(frequency(key), rel=0.01)


def test_notes_follow_one_another_and_a_rest_is_silent():
    strokes = [Stroke(0.5, 39, True), Stroke(1.0, 39, False), Stroke(2.0, 46, True), Stroke(2.5, 46, False)]
    samples = heard(strokes, 3.5)
    assert len(samples) == round(3.5 * RATE)
    assert not samples[: round(0.5 * RATE)].any()
    assert pitch(samples, 0.55, 0.95) == pytest.approx(261.63, rel=0.01)
    assert np.abs(samples[round(1.6 * RATE) : round(2.0 * RATE)]).max() == 0.0
    assert pitch(samples, 2.05, 2.45) == pytest.approx(392.0, rel=0.01)
    assert np.abs(samples[round(3.1 * RATE) :]).max() == 0.0


def test_it_may_be_asked_for_in_pieces():
    strokes = [Stroke(0.1, 30, True), Stroke(0.3, 37, True), Stroke(0.7, 30, False), Stroke(0.8, 30, True)]
    assert np.array_equal(heard(strokes, 1.5), heard(strokes, 1.5, pieces=60))


def test_nothing_clicks_and_nothing_is_cut_off():
    """A click is a jump: louder from one sample to the next than the steepest sine that there is."""
    many = [Stroke(0.1 + 0.01 * i, 40 + i, True) for i in range(8)]
    many += [Stroke(1.0, 40 + i, False) for i in range(8)]
    samples = heard(many, 2.0)
    assert 0.7 < np.abs(samples).max() < 0.97
    one = heard([Stroke(0.1, 27, True), Stroke(0.6, 27, False), Stroke(0.65, 27, True)], 1.0)
    steepest = np.abs(np.diff(tone(27))).max()
    for second in (0.1, 0.6, 0.65):  # struck, released in full sound, struck again
        around = one[round((second - 0.002) * RATE) : round((second + 0.002) * RATE)]
        assert np.abs(np.diff(around)).max() <= steepest
    assert np.abs(one).max() < 0.7


def test_a_key_that_is_held_for_long_falls_silent():
    samples = heard([Stroke(0.0, 60, True)], 7.0)
    first, last = np.abs(samples[: RATE // 2]).max(), np.abs(samples[5 * RATE : 6 * RATE]).max()
    assert 0.0 < last < 0.2 * first
    assert not samples[6 * RATE + 1 :].any()


def test_strokes_are_the_changes():
    before, now = np.zeros(88, dtype=bool), np.zeros(88, dtype=bool)
    before[[3, 5]] = now[[5, 7]] = True
    assert strokes_between(before, now, 1.5) == (Stroke(1.5, 3, False), Stroke(1.5, 7, True))


def test_a_wav_holds_the_samples():
    file = BytesIO()
    write_wav(file, np.array([0.0, 0.5, -1.0], dtype=np.float32))
    file.seek(0)
    with wave.open(file) as content:
        assert (content.getnchannels(), content.getframerate(), content.getsampwidth()) == (1, RATE, 2)
        assert np.frombuffer(content.readframes(9), "<i2").tolist() == [0, 16384, -32767]
