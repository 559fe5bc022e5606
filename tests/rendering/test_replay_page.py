"""The page of a run: its recorded poses and its caption."""

import base64
import json
import re

import msgspec
import numpy as np
import pytest
import zstandard
from pendulum import PENDULUM
from records import record_of

from humanoid_sim.errors import InputError
from humanoid_sim.messages import Mode
from humanoid_sim.mit import MITState
from humanoid_sim.rendering.poses import Poses
from humanoid_sim.rendering.replay_page import write_page


def tick(time, qpos, mode=Mode.STANDBY):
    return record_of(MITState.unknown(1, time), mode, qpos=qpos)


def scene_of(path):
    """The recorded scene of a page: s, and its messages with their s and arrays."""
    packed = base64.b64decode(re.search(r'__VISER_EMBED_DATA__="([^"]+)"', path.read_text("utf-8")).group(1))
    content = zstandard.ZstdDecompressor().decompress(packed[8:])
    end = 8 + int.from_bytes(content[:8], "little")
    scene = msgspec.msgpack.decode(content[8:end])
    return scene["durationSeconds"], [(time, message) for time, message in scene["messages"]]


def test_a_page_holds_poses_and_modes_at_their_times(tmp_path):
    poses = Poses()
    poses.tick(tick(4.9, None))  # not a simulated robot's
    for index in range(201):
        mode = Mode.STANDBY if index < 80 else Mode.LOCOMOTION
        poses.tick(tick(5.0 + index / 200, [0.1 + index / 100], mode))
    page = tmp_path / "run.html"
    write_page(page, PENDULUM, poses, title="a <b>")
    seconds, messages = scene_of(page)
    assert seconds == pytest.approx(26 / 25)
    shown = [time for time, message in messages if "batched_wxyzs" in message.get("updates", {})]
    assert sorted(set(shown)) == pytest.approx(np.arange(26) / 25)
    text = page.read_text("utf-8")
    assert "<title>a &lt;b&gt;</title>" in text
    (first, before), (second, after) = json.loads(re.search(r"const spans = (.*);", text).group(1))
    assert (before, after, first, second) == ("STANDBY", "LOCOMOTION", 0.0, pytest.approx(0.4))


def test_a_long_run_is_kept_whole_at_a_lower_rate():
    poses = Poses()
    for index in range(6000):
        poses.tick(tick(index / 25, [0.0]))
    assert (len(poses.kept), poses.rate) == (3000, 12.5)
    assert (poses.kept[0].time, poses.kept[-1].time) == (0.0, pytest.approx(239.92))


def test_nothing_to_show_is_an_error_and_no_file(tmp_path):
    with pytest.raises(InputError, match=r"page '.*run\.html': nothing to show"):
        write_page(tmp_path / "run.html", PENDULUM, Poses(), title="")
    assert list(tmp_path.iterdir()) == []
