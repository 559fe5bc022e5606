import os
import signal
import subprocess
import sys
import time

import pytest
from local_session import HEADER
from waiting import until

from humanoid_sim.cli import FRONT_ENDS, FrontEnd
from humanoid_sim.errors import InputError, MissingPackageError
from humanoid_sim.frontends import Wanted, launcher, require_packages
from humanoid_sim.frontends.launcher import FrontEnds

pytestmark = pytest.mark.soak

POPEN = subprocess.Popen
STAYS = "import time; print('up', flush=True); time.sleep(60)"


@pytest.fixture
def launch(local, monkeypatch, tmp_path):
    """Starts front ends whose program is a line of Python."""

    def start(*programs, restarts=0):
        def popen(command, **options):
            assert command[1:5] == [
                "-m",
                f"humanoid_sim.{command[2].rpartition('.')[2]}",
                "--session",
                str(os.getpid()),
            ]
            index = int(command[2].rpartition("_")[2])
            return POPEN([sys.executable, "-c", programs[index]], **options)

        monkeypatch.setattr(launcher.subprocess, "Popen", popen)
        front_ends = FrontEnds(
            [Wanted(f"fake_{i}", restarts=restarts) for i in range(len(programs))],
            local.feed,
            show=lambda text: None if text.startswith("waiting for ") else local.told.append(text),
            note=lambda text: local.told.append(f"recorded: {text}"),
            status=lambda: {"front_ends": dict(front_ends.running)},
        )
        local.stack.callback(front_ends.close)
        front_ends.start(HEADER)
        return front_ends

    return start


def test_they_end_with_the_session_however_stubborn(launch, local, monkeypatch):
    monkeypatch.setattr(launcher, "_GRACE", 0.2)
    stubborn = (
        "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('up', flush=True); time.sleep(60)"
    )
    front_ends = launch(stubborn)
    until(lambda: local.told == ["fake_0: up"])
    (process,) = front_ends.running.values()
    front_ends.close()
    front_ends.close()
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)


def test_one_that_was_killed_is_recorded(launch, local):
    front_ends = launch(STAYS)
    os.kill(next(iter(front_ends.running.values())), signal.SIGKILL)
    until(lambda: local.told == ["fake_0: up", "recorded: front end fake_0 ended with status -9"])


def test_one_that_may_is_started_again_up_to_a_limit_and_its_operator_is_told(launch, local, monkeypatch):
    monkeypatch.setattr(launcher, "_RESTART_AFTER", 0.1)
    front_ends = launch(STAYS, restarts=2)
    seen = set()
    for count in (1, 2, 3):
        until(lambda: local.told.count("fake_0: up") == count)  # noqa: B023 - waited for here
        (process,) = front_ends.running.values()
        seen.add(process)
        os.kill(process, signal.SIGKILL)
    ended = "recorded: front end fake_0 ended with status -9"
    until(lambda: local.told.count(ended) == 3)
    assert len(seen) == 3
    assert [line for line in local.told if "again" in line] == [
        "recorded: front end fake_0 was started again, 1 of 2 times",
        "recorded: front end fake_0 was started again, 2 of 2 times",
        "recorded: front end fake_0 is not started again: it ended 3 times",
    ]
    time.sleep(0.4)
    assert dict(front_ends.running) == {}


def test_one_that_ends_before_it_is_ready_keeps_the_session_from_beginning(launch, local):
    with pytest.raises(InputError, match="front end fake_1: ended before it was ready: no display"):
        launch(STAYS, "import sys; print('error: no display', file=sys.stderr); sys.exit(2)")
    with pytest.raises(InputError, match="front end fake_0: ended before it was ready: status 3"):
        launch("raise SystemExit(3)")


def test_packages_that_are_missing_are_named_with_their_extra(monkeypatch):
    fakes = {**FRONT_ENDS, "fake": FrontEnd("", "a fake", packages=("json", "no_such_package"), extra="fake")}
    monkeypatch.setattr("humanoid_sim.frontends.FRONT_ENDS", fakes)
    with pytest.raises(MissingPackageError, match=r"a fake needs the package 'no_such_package'.*humanoid_sim\[fake\]"):
        require_packages("fake")
    require_packages("gravity")
