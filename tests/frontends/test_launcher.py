import os
import subprocess
import sys

import pytest
from local_session import HEADER
from waiting import until

from humanoid_sim.errors import InputError
from humanoid_sim.frontends import launcher
from humanoid_sim.frontends.launcher import FrontEnds

pytestmark = pytest.mark.soak

POPEN = subprocess.Popen
STAYS = "import time; print('up', flush=True); time.sleep(60)"
STUBBORN = "import signal, time; signal.signal(15, signal.SIG_IGN); print('up', flush=True); time.sleep(60)"


@pytest.fixture
def launch(local, monkeypatch):
    """Starts front ends whose program is a line of Python."""

    def start(*programs):
        def popen(command, **options):
            assert command[3:5] == ["--session", str(os.getpid())]
            return POPEN([sys.executable, "-c", programs[int(command[2].rpartition("_")[2])]], **options)

        monkeypatch.setattr(launcher.subprocess, "Popen", popen)
        front_ends = FrontEnds(
            [(f"fake_{i}",) for i in range(len(programs))],
            local.feed,
            show=lambda text: None if text.startswith("waiting for ") else local.told.append(text),
            note=lambda text: local.told.append(f"recorded: {text}"),
            status=dict,
            is_ending=lambda: False,
        )
        local.stack.callback(front_ends.close)
        front_ends.start(HEADER)
        return front_ends

    return start


def test_they_end_with_the_session_however_stubborn(launch, local, monkeypatch):
    monkeypatch.setattr(launcher, "_GRACE", 0.2)
    front_ends = launch(STUBBORN)
    until(lambda: local.told == ["fake_0: up"])
    (process,) = front_ends.running.values()
    front_ends.close()
    front_ends.close()
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)


def test_one_that_ends_before_it_is_ready_keeps_the_session_from_beginning(launch):
    with pytest.raises(InputError, match="front end fake_1: ended before the session began: error: no display"):
        launch(STAYS, "import sys; print('error: no display', file=sys.stderr); sys.exit(2)")
    with pytest.raises(InputError, match="front end fake_0: ended before the session began: status 3"):
        launch("raise SystemExit(3)")
