from dataclasses import replace

import av
import numpy as np
import pytest
from PIL import Image

from humanoid_sim.errors import InputError
from humanoid_sim.messages import Mode
from humanoid_sim.mit import Extern
from humanoid_sim.rendering.caption import Caption, draw_caption
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
