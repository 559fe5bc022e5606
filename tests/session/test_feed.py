import os
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rig
from local_session import LocalSession

from humanoid_sim.client import SLOT_HEAD, Feed, SessionError
from humanoid_sim.messages import Event, EventKind, Intent
from humanoid_sim.recording.codec import decode_event, decode_tick


def test_a_tick_arrives_bit_for_bit(local):
    with Feed(local.info) as feed:
        assert feed.latest() is None
        record = local.tick(Intent.DAMP)
        sample = feed.latest()
        assert sample.number == 1
        assert 0.0 <= sample.age() < 5.0
        again = decode_tick(sample.data)
        assert again.index == record.index
        assert again.output.control_mode == record.output.control_mode
        assert again.input.state.joint_position.tobytes() == record.input.state.joint_position.tobytes()


def test_it_carries_what_interprets_the_ticks(local):
    with Feed(local.info) as feed:
        assert feed.joint_names == rig.JOINTS
        assert feed.control_period == rig.PERIOD
        assert feed.document("robot") == "{}"
        assert feed.document("contract") == ""
        assert set(feed.blobs) == {"motion.mcap", "model.mjb"}
        assert feed.blob("motion.mcap") == b"motion"
        assert feed.blob("model.mjb") == b"model"


def test_a_client_decodes_by_the_definition_that_the_feed_carries(local):
    intake = local.intake()
    local.enter_remote()
    intake.remote(rig.JOINTS, *[[0.1, 0.2, 0.3]] * 5)
    intake.velocity(0.5, 0.0, 0.0, deliberate=True)
    record = local.tick(Intent.LOAD_B)
    with Feed(local.info) as feed:
        sample = feed.latest()
        assert sample is not None
        told = feed.decode(sample)
    state, output = record.input.state, record.output
    assert told["time"] == state.time
    for name in ("position", "velocity", "effort", "age"):
        np.testing.assert_array_equal(told[f"joint_{name}"], getattr(state, f"joint_{name}"))
    assert told["controller_name"] == "remote_policy_controller"
    assert told["refusals"] == list(output.refusals) == ["LOAD_B refused: requires DAMPING, mode is REMOTE"]
    assert told["intents"].tolist() == [2]
    assert told["remote"][0]["effort"].tolist() == [0.1, 0.2, 0.3]
    assert told["extern"][0]["name"] == "velocity_command"
    assert told["extern"][0]["value"].tolist() == [0.5, 0.0, 0.0]
    assert told["policy_step"] == []
    assert not told["joint_position"].flags.writeable


def test_the_last_ticks_and_all_events_can_be_read(local):
    with Feed(local.info) as feed:
        records = [local.tick() for _ in range(100)]
        numbers = [sample.number for sample in feed.since(0)]
        assert numbers == list(range(38, 101))
        assert [decode_tick(sample.data).index for sample in feed.since(97)] == [97, 98, 99]
        assert records[-1].index == 99
        assert list(feed.since(100)) == []
        local.feed.event(Event(1.5, "x" * 5000, EventKind.FAILURE))
        local.feed.event(Event(2.5, "é" * 205 + "\ud800", EventKind.NOTE))
        assert feed.newest("event") == 0  # with the next tick
        local.tick()
        first, second = (decode_event(sample.data) for sample in feed.since(0, "event"))
        assert (first.time, first.kind, len(first.text)) == (1.5, EventKind.FAILURE, 206)
        assert second.time == 2.5
        assert feed.decode(next(feed.since(0, "event")), "event")["text"] == first.text


def test_a_status_is_told_beside_the_ticks(local):
    with Feed(local.info) as feed:
        assert feed.status() == {}
        local.feed.status({"owners": {"REMOTE": "me (1)"}})
        local.feed.status({"too long": "x" * 100_000})
        assert feed.status() == {"owners": {"REMOTE": "me (1)"}}


def test_waiting_ends_with_the_tick_the_time_or_the_session(local):
    with Feed(local.info) as feed:
        assert feed.wait(0, 0.01) is None
        local.tick()
        sample = feed.wait(0, 0.0)
        assert sample.number == 1
        assert feed.is_running()
        local.feed.close()
        assert not feed.is_running()
        assert feed.wait(1, 60.0) is None
        assert feed.sample(1) == sample  # what is mapped stays


def test_a_tick_that_does_not_fit_is_left_out_and_counted(local):
    local.run.step(Intent.DAMP)
    record = local.tick()
    local.feed.tick(replace(record, qpos=np.zeros(50_000)))
    assert local.feed.left_out == 1
    with Feed(local.info) as feed:
        assert feed.newest() == 1


def test_every_torn_copy_is_detected(local):
    """Whatever part of a slot is of another sample, as on a processor that shows writes out of order."""
    for _ in range(65):
        local.tick()
    with Feed(local.info) as feed:
        offset, slots, size = feed._rings["tick"]
        memory = local.feed._memory
        start = offset + 64 + (65 % slots) * size
        sample = feed.sample(65)
        length = SLOT_HEAD.size + len(sample.data)
        new = bytes(memory[start : start + length])
        older = offset + 64 + (64 % slots) * size
        old = bytes(memory[older : older + length])
        torn = 0
        for cut in range(1, length):
            for mixed in (old[:cut] + new[cut:], new[:cut] + old[cut:]):
                memory[start : start + length] = mixed
                found = feed.sample(65)
                assert found in (None, sample)
                torn += found is None
        assert torn > length


def test_a_reader_that_races_the_writer_sees_whole_samples_alone(local):
    code = f"""
import sys, time
from humanoid_sim.client import Feed, find_session
from humanoid_sim.recording.codec import decode_tick
with Feed(find_session({os.getpid()})) as feed:
    print("ready", flush=True)
    seen, last = 0, 0
    while last < 3000:
        sample = feed.latest()
        if sample is None or sample.number == last:
            continue
        assert sample.number > last
        last, seen = sample.number, seen + 1
        assert decode_tick(sample.data).index == last - 1
    print(seen)
"""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as reader:
        reader.stdout.readline()
        deadline = time.monotonic() + 30.0
        while reader.poll() is None and time.monotonic() < deadline:
            local.tick()
        assert int(reader.stdout.read()) > 10


ATTACKS = {
    "write": "os.write(os.open(path, os.O_RDWR), b'x')",
    "map": "mmap.mmap(os.open(path, os.O_RDWR), 0)",
    "shorten": "os.truncate(path, 0)",
    "lengthen": "os.truncate(path, 1 << 30)",
    "unseal": "fcntl.fcntl(os.open(path, os.O_RDWR), fcntl.F_ADD_SEALS, fcntl.F_SEAL_WRITE)",
    "remove": "os.unlink(path)",
}
ATTACKER = f"""
import fcntl, mmap, os, sys
from humanoid_sim.client import find_session
path = find_session(int(sys.argv[1])).feed
for name, attack in {ATTACKS}.items():
    try:
        exec(attack)
    except PermissionError:
        print(name)
"""


def test_no_program_of_the_same_user_can_write_resize_or_remove_it(local):
    """A feed that is shortened under its writer would kill the loop with a signal."""
    local.tick()
    command = [sys.executable, "-W", "error", "-W", "ignore::ResourceWarning", "-c", ATTACKER, str(os.getpid())]
    refused = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    assert refused == list(ATTACKS)
    local.tick()
    with Feed(local.info) as feed:
        assert feed.newest() == 2
        with pytest.raises(TypeError):
            feed._map[0] = 1


def test_a_reader_that_exits_leaves_it_to_others(local):
    local.tick()
    code = f"from humanoid_sim.client import Feed, find_session; print(Feed(find_session({os.getpid()})).newest())"
    for _ in range(2):
        out = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=True)
        assert (out.stdout, out.stderr) == ("1\n", "")


STRANGER = """
import os, socket, sys
os.setgroups([])
os.setgid(65534)
os.setuid(65534)
for path in sys.argv[1:3]:
    try:
        print(os.open(path, os.O_RDONLY))
    except OSError as error:
        print(error.strerror)
for path in sys.argv[3:]:
    try:
        print(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM).connect(path))
    except OSError as error:
        print(error.strerror)
"""


@pytest.mark.skipif(os.getuid() != 0, reason="only root can be somebody else")
def test_another_user_reaches_neither_feed_nor_file_nor_sockets(monkeypatch):
    with tempfile.TemporaryDirectory() as runtime:
        os.chmod(runtime, 0o755)  # so that only what the session makes keeps others out
        monkeypatch.setenv("XDG_RUNTIME_DIR", runtime)
        local = LocalSession()
        with local.stack:
            ends = [local.feed.path, local.registration.path, local.registration.intents, local.registration.data]
            command = [sys.executable, "-I", "-c", STRANGER, *map(str, ends)]
            out = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
            assert out == ["Permission denied"] * 4
            assert local.registration.path.parent.stat().st_mode & 0o777 == 0o700
            assert [end.stat().st_mode & 0o777 for end in ends] == [0o600] * 4


def test_what_is_no_feed_is_refused(local, tmp_path):
    info = local.info
    memory = local.feed._memory
    memory[0:8] = b"hsfeed99"
    with pytest.raises(SessionError, match="its feed is of another version of this program"):
        Feed(info)
    local.feed.close()
    with pytest.raises(SessionError, match="its feed cannot be opened: No such file"):
        Feed(info)
    for other in (os.open(tmp_path, os.O_RDONLY), os.memfd_create("empty"), os.open("/etc/passwd", os.O_RDONLY)):
        try:  # whatever has its number now
            with pytest.raises(SessionError, match=r"its feed (cannot be opened|is of another version)"):
                Feed(replace(info, feed=f"/proc/{os.getpid()}/fd/{other}"))
        finally:
            os.close(other)


def test_nothing_is_left_of_a_killed_session():
    code = """
import os, signal
from humanoid_sim.messages import SessionHeader
from humanoid_sim.session.feed import FeedWriter
print(FeedWriter(SessionHeader("r", ("a",), 0.02, 0)).path, flush=True)
input()
"""
    with subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as killed:
        left = Path(killed.stdout.readline().strip())
        assert left.exists()
        killed.kill()
    assert not left.exists()
    assert not list(Path("/dev/shm").glob(f"humanoid_sim*{killed.pid}*"))


def test_closing_twice_leaves_nothing(local):
    assert local.feed.path.exists()
    local.feed.close()
    local.feed.close()
    assert not local.feed.path.exists()
