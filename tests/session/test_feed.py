"""Subscribers of a session's ticks: late, slow and killed ones."""

import os
import signal
import subprocess
import sys

import numpy as np
import pytest
from waiting import until

from humanoid_sim.client import Feed, SessionError
from humanoid_sim.messages import Intent
from humanoid_sim.recording.codec import decode_tick

SUBSCRIBER = """
import sys, time
from humanoid_sim.client import *
with Feed(find_session(int(sys.argv[1]))) as feed:
    print(flush=True)
    time.sleep(600)
"""


def test_a_subscriber_gets_ticks_files_and_what_interprets_them(local):
    local.tick()
    with Feed(local.info) as feed:
        assert feed.latest() is None, "nothing before it subscribed"
        assert (feed.joint_names, feed.control_period) == (("shoulder", "elbow", "wrist"), 0.02)
        assert (feed.live_inputs, feed.document("robot"), feed.document("none")) == ({"keys": 2, "pose": 1}, "{}", "")
        assert (feed.blob("model.mjb"), feed.blob("motion.mcap")) == (b"model", b"motion")
        with pytest.raises(KeyError):
            feed.blob("none")
        local.tick(Intent.DAMP)
        sample = feed.wait(0, 10.0)
        assert (sample.number, feed.latest(), feed.since(1), feed.since(2)) == (2, sample, [sample], [])
        assert feed.wait(2, 0.001) is None
        assert local.sent <= sample.stamp
        assert feed.decode(sample)["mode"] == 1
        np.testing.assert_array_equal(decode_tick(sample.data).input.state.joint_position, [0.4, 0.5, 0.6])
        assert feed.is_running()
        local.stack.close()
        assert not feed.is_running()
    with pytest.raises(SessionError, match="cannot be reached"):
        Feed(local_info := feed.session)
    assert not local_info.path.exists()


def test_a_new_subscriber_gets_the_latest_status(local):
    local.feed.status({"owners": {"REMOTE": "gravity"}})
    with Feed(local.info) as feed:
        local.tick()
        assert until(feed.status) == {"owners": {"REMOTE": "gravity"}}


def test_a_subscriber_that_is_stopped_or_killed_holds_nothing_up(local):
    command = [sys.executable, "-c", SUBSCRIBER, str(os.getpid())]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as other, Feed(local.info) as feed:
        other.stdout.readline()
        local.tick()
        other.send_signal(signal.SIGSTOP)
        for number in range(2, 600):
            local.tick()
            assert feed.wait(number - 1, 10.0).number == number
        assert len(feed.since(0)) == 256
        other.kill()
        other.wait()
        before = len(local.feed._subscribers)
        local.tick()
        assert (before, len(local.feed._subscribers)) == (2, 1)
