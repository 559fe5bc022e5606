import os
import resource
import signal
import subprocess
import sys
import threading
import wave
from contextlib import contextmanager
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from time import monotonic, sleep

import av
import numpy as np
import pytest
from PIL import Image

from humanoid_sim.errors import InputError
from humanoid_sim.messages import Mode
from humanoid_sim.mit import Extern
from humanoid_sim.rendering.caption import Caption, draw_caption
from humanoid_sim.rendering.drawing import Job, Moment, draw_video
from humanoid_sim.rendering.piano_sound import Stroke
from humanoid_sim.rendering.video import VideoSink, save_snapshot

SIZE = (160, 120)


@pytest.fixture(autouse=True)
def _painter(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "off")


def decode(path):
    """The frames, how many a second, and how they are encoded; there is nothing else in the file."""
    with av.open(str(path)) as container:
        (stream,) = container.streams
        frames = [frame.to_ndarray(format="rgb24").astype(np.int64) for frame in container.decode(stream)]
        assert stream.average_rate is not None
        return frames, float(stream.average_rate), f"{stream.codec_context.name} {stream.codec_context.pix_fmt}"


def times(path):
    """s, of each frame."""
    with av.open(str(path)) as container:
        return [float(frame.time) for frame in container.decode(video=0)]


def test_a_second_of_ticks_is_a_second_of_video(tmp_path, pendulum, make_tick):
    sink = VideoSink(tmp_path / "run.mp4", lambda: pendulum, fps=30, size=SIZE)
    for index in range(201):
        sink.tick(make_tick(index, 5.0 + index / 200, [index / 100]))
    done = []
    report = sink.finish(lambda count, total: done.append((count, total)))

    frames, rate, kind = decode(tmp_path / "run.mp4")
    assert (len(frames), rate, kind) == (31, 30.0, "h264 yuv420p")
    assert all(frame.shape == (120, 160, 3) for frame in frames)
    assert done == sorted(done)
    assert done[-1] == (31, 31)
    assert (report.frame_count, report.duration, report.notice) == (31, pytest.approx(1.0), "")
    assert report.backend == "software painter (MUJOCO_GL=off)"
    assert np.abs(frames[0] - frames[30]).max() > 60, "the pendulum has moved"
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.mp4"]


def test_the_time_between_frames_is_the_robots_and_a_pose_that_is_not_finite_shows_the_one_before(
    tmp_path, pendulum, make_tick
):
    sink = VideoSink(tmp_path / "run.mp4", lambda: pendulum, fps=10, size=SIZE)
    for index, time in enumerate([0.0, 0.05, 0.1, 0.5, 0.4, np.nan, 0.4, 0.5, 1e9]):
        sink.tick(make_tick(index, time, [np.nan if time == 0.5 else 1.0]))
    # 0.5 s forward, a step back that counts as none, 0.1 s forward, and a jump that counts as one second.
    assert sink.finish().duration == pytest.approx(1.6)
    assert times(tmp_path / "run.mp4") == pytest.approx([0.0, 0.1, 0.5, 0.6, 1.6])
    robot = [frame[:100] for frame in decode(tmp_path / "run.mp4")[0]]
    assert np.abs(robot[1] - robot[2]).mean() < 2.0


def test_a_long_run_keeps_its_length_at_a_lower_rate(tmp_path, pendulum, make_tick):
    sink = VideoSink(tmp_path / "run.mp4", lambda: pendulum, fps=32, size=SIZE, max_frames=20)
    for index in range(401):
        sink.tick(make_tick(index, index / 100, [0.0]))
    report = sink.finish()
    assert report.notice == "a long run: towards its end 8 instead of 32 frames per second"
    shown = times(tmp_path / "run.mp4")
    assert len(shown) == report.frame_count
    assert shown[-1] == report.duration == pytest.approx(4.0, abs=0.13)
    steps = np.diff(shown)
    assert steps[0] == pytest.approx(1 / 32)
    assert (np.diff(steps) >= -1e-9).all()
    assert steps[-1] == pytest.approx(1 / 8)


def test_nothing_to_show_is_an_error_and_no_file(tmp_path, pendulum, make_tick):
    sink = VideoSink(tmp_path / "run.mp4", lambda: pendulum, size=SIZE)
    sink.tick(make_tick(0, 0.0, None))
    with pytest.raises(InputError, match=r"nothing to show: no tick came from a simulated robot"):
        sink.finish()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"fps": 0}, r"frame rate is 0, accepted: 1 and more"),
        ({"size": (161, 120)}, r"size is 161x120, accepted: even numbers from 16"),
        ({"size": (0, 0)}, r"size is 0x0"),
    ],
)
def test_bad_options_are_refused_before_the_run(tmp_path, pendulum, options, message):
    with pytest.raises(InputError, match=message):
        VideoSink(tmp_path / "run.mp4", lambda: pendulum, **options)


@contextmanager
def full_disk():
    """Files stop growing at 4 KiB; Python ignores the signal that comes with it, so writes fail.

    The limit is the whole process's, and the test runner's own log is a file: only around the write itself.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_full_disk_leaves_no_half_of_a_video(tmp_path, pendulum, make_tick):
    sink = VideoSink(tmp_path / "run.mp4", lambda: pendulum, fps=30, size=(640, 480))
    with full_disk():  # what is started has the limit too
        for index in range(60):
            sink.tick(make_tick(index, index / 30, [index / 10]))
        with pytest.raises(InputError, match=r"run\.mp4: cannot be written: File too large"):
            sink.finish()
    assert list(tmp_path.iterdir()) == []


def test_a_video_that_is_skipped_leaves_nothing(tmp_path, pendulum, make_tick):
    sink = VideoSink(tmp_path / "run.mp4", lambda: pendulum, fps=30, size=SIZE)
    for index in range(3000):
        sink.tick(make_tick(index, index / 30, [index / 10]))

    def press(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sink.finish(press)
    assert list(tmp_path.iterdir()) == []
    assert [thread.name for thread in threading.enumerate() if "video" in thread.name] == []


def test_a_drawing_process_that_is_killed_is_told(tmp_path, pendulum, make_tick):
    sink = VideoSink(tmp_path / "run.mp4", lambda: pendulum, fps=30, size=SIZE)
    for index in range(3000):
        sink.tick(make_tick(index, index / 30, [index / 10]))

    killed = []

    def kill(done, total):
        if done and not killed:
            assert sink.process_id is not None
            os.kill(sink.process_id, signal.SIGKILL)
            killed.append(done)

    with pytest.raises(InputError, match=r"run\.mp4: the drawing process ended, status -9"):
        sink.finish(kill)
    assert list(tmp_path.iterdir()) == []


_WAITS = """
import sys
import mujoco, numpy as np
from humanoid_sim.messages import ControlMode, Mode, TickInput, TickOutput, TickRecord
from humanoid_sim.mit import MITCommand, MITState
from humanoid_sim.rendering.video import VideoSink

xml = '<mujoco><worldbody><body><joint/><geom size="0.1"/></body></worldbody></mujoco>'
model = mujoco.MjModel.from_xml_string(xml)
video = VideoSink(sys.argv[1], lambda: model, fps=30, size=(1920, 1080))
output = TickOutput(MITCommand.zeros(1), ControlMode(Mode.STANDBY, "standby_controller_a"))
for index in range(100):
    video.tick(TickRecord(index, TickInput(MITState.unknown(1, index / 30)), output, 0.001, False, np.zeros(1)))
video.finish(lambda done, total: print(video.process_id, flush=True) if done else None)
"""


def test_a_drawing_process_ends_with_the_program_that_wants_the_video(tmp_path):
    """It has been told of every frame, and would draw them all and leave a file that nobody renames."""
    command = [sys.executable, "-c", _WAITS, str(tmp_path / "run.mp4")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as parent:
        drawing = int(parent.stdout.readline())
        parent.terminate()
    deadline = monotonic() + 20.0
    while Path(f"/proc/{drawing}").exists() and " Z " not in Path(f"/proc/{drawing}/stat").read_text(encoding="utf-8"):
        assert monotonic() < deadline
        sleep(0.02)
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_leaves_no_half_of_a_snapshot(tmp_path, pendulum):
    with pytest.raises(InputError, match=r"run\.png: cannot be written: File too large"), full_disk():
        save_snapshot(tmp_path / "run.png", pendulum, np.zeros(1))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["run.png", "run.jpg"])
def test_a_snapshot_is_a_picture_of_the_pose(tmp_path, pendulum, name):
    pictures = []
    for angle in (0.0, 1.0, np.nan):
        backend = save_snapshot(tmp_path / name, pendulum, np.array([angle]), size=(320, 240))
        assert backend == "software painter (MUJOCO_GL=off)"
        with Image.open(tmp_path / name) as image:
            assert (image.size, image.format) == ((320, 240), "PNG" if name.endswith("png") else "JPEG")
            pictures.append(np.asarray(image, dtype=np.int64))
    assert np.abs(pictures[0] - pictures[1]).max() > 60
    np.testing.assert_array_equal(pictures[0], pictures[2])
    with pytest.raises(InputError, match=r"snapshot: is '.*\.bmp', expected a name that ends in \.png or "):
        save_snapshot(tmp_path / "run.bmp", pendulum, np.zeros(1))


def test_the_caption_says_who_is_in_control():
    blank = np.full((480, 640, 3), 200, dtype=np.uint8)

    def strip(mode, message):
        picture = draw_caption(blank, Caption(1.25, mode, "damping_controller", message))
        np.testing.assert_array_equal(picture[:440], blank[:440])
        return picture[450:].astype(np.int64)

    assert strip(Mode.DAMPING, "").mean() < 100
    assert np.abs(strip(Mode.DAMPING, "") - strip(Mode.LOCOMOTION, "")).max() > 60
    assert np.abs(strip(Mode.DAMPING, "") - strip(Mode.DAMPING, "LOAD_A refused")).max() > 60
    np.testing.assert_array_equal(strip(Mode.DAMPING, "m" * 500)[:, -4:], strip(Mode.DAMPING, "")[:, -4:])


def with_keys(tick, *keys):
    pressed = np.zeros(88)
    pressed[list(keys)] = 1.0
    state = replace(tick.input.state, extern={"key_pressed": Extern(pressed, float(tick.input.state.time))})
    return replace(tick, input=replace(tick.input, state=state))


def played(sink, make_tick):
    """Key C4 from 0.5 to 1 s, and A5, which is down and up between two frames' times, at 2 s."""
    for index in range(501):
        keys = [39] * (100 <= index < 200) + [60] * (401 <= index < 406)
        sink.tick(with_keys(make_tick(index, 7.0 + index / 200, [index / 100]), *keys))


def loudest(samples, begin, end):
    """Hz."""
    part = samples[round(begin * 44100) : round(end * 44100)]
    return float(np.argmax(np.abs(np.fft.rfft(part * np.hanning(len(part)), 1 << 17))) * 44100 / (1 << 17))


def test_keys_that_were_pressed_are_heard(tmp_path, pendulum, make_tick):
    sink = VideoSink(tmp_path / "run.mp4", lambda: pendulum, fps=10, size=SIZE)
    played(sink, make_tick)
    report = sink.finish()
    assert (report.sound, report.frame_count) == (None, 26)
    with av.open(str(tmp_path / "run.mp4")) as container:
        assert [stream.codec_context.name for stream in container.streams] == ["h264", "aac"]
        samples = np.concatenate([frame.to_ndarray()[0] for frame in container.decode(audio=0)])
    assert len(samples) == pytest.approx(2.5 * 44100, abs=2048)
    assert np.abs(samples[: round(0.47 * 44100)]).max() < 1e-3
    assert loudest(samples, 0.55, 0.95) == pytest.approx(261.63, rel=0.01)
    assert np.abs(samples[round(1.6 * 44100) : round(1.97 * 44100)]).max() < 1e-3
    assert loudest(samples, 2.01, 2.1) == pytest.approx(880.0, rel=0.02)
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.mp4"]


def test_without_an_encoder_the_sound_is_beside_the_video(tmp_path, pendulum, monkeypatch):
    monkeypatch.setattr(av, "codecs_available", av.codecs_available - {"aac"})
    job = Job(str(tmp_path / "run.mp4"), pendulum, SIZE, Fraction(10), wav=str(tmp_path / "run.wav"))
    caption = Caption(0.0, Mode.LOCOMOTION, "rl_policy_controller")
    struck = (Stroke(0.0, 48, True),)
    moments = [Moment(i / 10, np.zeros(1), caption, strokes=struck if i == 0 else ()) for i in range(6)]
    assert draw_video(job, iter(moments), lambda _: None) == ("software painter (MUJOCO_GL=off)", True)
    with wave.open(str(tmp_path / "run.wav")) as sound:
        samples = np.frombuffer(sound.readframes(44100), "<i2").astype(float)
    assert len(samples) == 22050
    assert loudest(samples, 0.05, 0.45) == pytest.approx(440.0, rel=0.01)
    with av.open(str(tmp_path / "run.mp4")) as container:
        assert [stream.type for stream in container.streams] == ["video"]
