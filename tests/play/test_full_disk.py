"""Folders without room: in a mount namespace of their own, where anybody may mount a small file system."""

import subprocess
import sys

import pytest

SMALL = (
    "mount -t tmpfs -o size={size} tmpfs {folder} && cd {folder} && mkdir run && export XDG_RUNTIME_DIR={folder}/run"
)
PLAY = (
    f"{sys.executable} -m humanoid_sim.play --policy placeholder --viewer none --html none --pace fast "
    "--script 'hold 1; damp; hold 0.2; load_a; wait; start_locomotion; hold 5; damp; hold 1'"
)


def in_namespace(*commands):
    """Run in a shell that is root over file systems of its own, until one fails; skip where that is not permitted."""
    unshare = ("unshare", "--user", "--map-root-user", "--mount")
    try:
        subprocess.run([*unshare, "true"], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("this system gives no mount namespaces (unshare)")
    return subprocess.run([*unshare, "sh", "-c", " && ".join(commands)], check=False, capture_output=True, text=True)


@pytest.mark.soak
def test_a_run_goes_on_where_its_recording_has_no_room_and_shared_memory_none(runtime):
    run = in_namespace(
        SMALL.format(size="1m", folder=runtime),
        "mount -t tmpfs -o size=16k tmpfs /dev/shm",
        f"{PLAY} --record r.mcap; echo status $?",
        f"{sys.executable} -m humanoid_sim.replay r.mcap; echo status $?",
    )
    played, _, replayed = run.stdout.partition("status 1\n")
    stopped = played.index("r.mcap: recording stopped: No space left on device")
    assert stopped < played.index("LOCOMOTION → DAMPING  DAMP requested"), "told when it happened"
    assert "failed: recording: r.mcap: recording stopped: No space left on device" in played
    assert "ticks, bit for bit identical" in replayed
    assert "the recording is not complete" in replayed
