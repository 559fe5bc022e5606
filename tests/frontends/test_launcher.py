import os
import signal
import subprocess
import sys
import time

import pytest
from local_session import HEADER
from waiting import until

from humanoid_sim.cli import FRONT_ENDS, FrontEnd
from humanoid_sim.client import Feed
from humanoid_sim.errors import InputError, MissingPackageError
from humanoid_sim.frontends import Wanted, launcher, require_packages
from humanoid_sim.frontends.launcher import FrontEnds

pytestmark = pytest.mark.soak

POPEN = subprocess.Popen
WAIT = FrontEnds._wait_until_ready
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


def test_what_they_say_is_shown_and_their_end_recorded(launch, local):
    front_ends = launch("print('http://127.0.0.1:1/?token=x'); raise SystemExit(3)", STAYS)
    until(lambda: len(local.told) == 3)
    assert sorted(local.told) == [
        "fake_0: http://127.0.0.1:1/?token=x",
        "fake_1: up",
        "recorded: front end fake_0 ended with status 3",
    ]
    assert list(front_ends.running) == ["fake_1"]
    with Feed(local.info) as feed:
        until(lambda: feed.status() == {"front_ends": dict(front_ends.running)})


def test_the_status_names_them_before_they_speak(launch, local, monkeypatch):
    seen = []

    class Watching(list[str]):
        def append(self, text):
            seen.append(feed.status().get("front_ends"))
            super().append(text)

    with Feed(local.info) as feed:
        monkeypatch.setattr(local, "told", Watching())
        front_ends = launch(STAYS, STAYS)
        assert seen == [dict(front_ends.running)] * 2
        assert list(seen[0]) == ["fake_0", "fake_1"]


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


def test_a_terminals_signals_do_not_reach_them(launch, local):
    front_ends = launch(STAYS)
    until(lambda: local.told)
    (process,) = front_ends.running.values()
    assert os.getsid(process) == process != os.getsid(0)
    assert os.sched_getscheduler(process) == os.SCHED_OTHER


def test_one_that_floods_its_output_is_read_in_bounded_pieces(launch, local):
    launch("while True: print('x' * 100)")
    time.sleep(0.5)
    assert 0 < len(local.told) < 41 * 6


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


def test_one_that_says_nothing_is_waited_for_no_longer_than_that(launch, local, monkeypatch):
    monkeypatch.setattr(launcher, "_READY", 0.2)
    front_ends = launch("import time; time.sleep(60)", "import time; time.sleep(60)")
    assert local.told == ["recorded: not ready after 0.2 s: fake_0, fake_1"]
    assert list(front_ends.running) == ["fake_0", "fake_1"]


def test_an_operator_reads_at_once_what_is_waited_for(launch, local, monkeypatch):
    shown = []

    def note(front_ends):
        monkeypatch.setattr(front_ends, "_show", shown.append)
        WAIT(front_ends)

    monkeypatch.setattr(FrontEnds, "_wait_until_ready", note)
    launch(STAYS, STAYS)
    assert shown[0] == "waiting for fake_0, fake_1 ..."
    shown.clear()
    launch()
    assert shown == []


def test_what_cannot_be_started_is_one_line_and_leaves_nothing(launch, monkeypatch):
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    with pytest.raises(InputError, match="--fake_0: cannot be started: No such file"):
        launch("pass")


def test_packages_that_are_missing_are_named_with_their_extra(monkeypatch):
    fakes = {**FRONT_ENDS, "fake": FrontEnd("", "a fake", packages=("json", "no_such_package"), extra="fake")}
    monkeypatch.setattr("humanoid_sim.frontends.FRONT_ENDS", fakes)
    with pytest.raises(MissingPackageError, match=r"a fake needs the package 'no_such_package'.*humanoid_sim\[fake\]"):
        require_packages("fake")
    require_packages("gravity")
