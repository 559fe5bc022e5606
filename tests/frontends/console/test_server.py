"""The console as strangers and pages meet it, over real connections."""

import contextlib
import http.client
import json
import os
import signal
import socket as sockets
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from humanoid_sim import replay
from humanoid_sim.cli import run_program
from humanoid_sim.messages import Event
from humanoid_sim.recording.reader import open_recording


@pytest.fixture(scope="module")
def played(start_play):
    """One run for all tests, at half the ticks: the last test replays them all."""
    return start_play("--control-frequency", "100")


def get(played, path, **headers):
    connection = http.client.HTTPConnection(played.authority, timeout=10)
    try:
        connection.request("GET", path, headers=headers)
        response = connection.getresponse()
        return response.status, response.read().decode()
    finally:
        connection.close()


def path_of(address):
    return "/" + address.split("/", 3)[3]


def socket(address, end="console", *, origin="", **options):
    """As a page opens it; `origin` may be another one, or None."""
    from websockets.sync.client import connect  # noqa: PLC0415 - an optional package

    host = "/".join(address.split("/")[:3])
    return connect(f"{address}{end}".replace("http", "ws", 1), origin=host if origin == "" else origin, **options)


def until(page, is_it):
    deadline = time.monotonic() + 10.0
    while time.monotonic() < deadline:
        message = page.recv(timeout=5.0)
        if isinstance(message, bytes):  # rows of a plot
            continue
        told = json.loads(message)
        if is_it(told):
            return told
    raise AssertionError("not told in time")


def ask(page, word):
    page.send(json.dumps({"ask": word, "seen": time.monotonic()}))
    answers = until(page, lambda told: told.get("answers"))["answers"]
    return answers[-1]


def answers_to(page, message):
    """The text with which a message is refused."""
    page.send(json.dumps(message) if isinstance(message, dict) else message)
    answers = until(page, lambda told: told.get("answers"))["answers"]
    assert answers[-1]["granted"] is False
    return str(answers[-1]["text"])


def test_pages_need_the_token_and_the_printed_address(played):
    path = path_of(played.control)
    assert get(played, path)[0] == 200
    assert "DAMP" in get(played, path)[1]
    assert get(played, path + "viser/")[1].startswith("<!doctype html>")
    connection = http.client.HTTPConnection(played.authority, timeout=10)
    with contextlib.closing(connection):  # the address as somebody types it
        connection.request("GET", path.removesuffix("/"))
        answer = connection.getresponse()
        assert (answer.status, answer.getheader("Location")) == (307, path)
    assert get(played, path.removesuffix("/")[:-1])[0] == 404
    assert get(played, "/") == (404, "not found")
    assert get(played, path + "../page.js") == (404, "not found")
    assert get(played, path.replace(path[5], "x" if path[5] != "x" else "y")) == (404, "not found")
    assert get(played, path, Host="evil.example") == (403, "Host is not the printed address")
    assert get(played, path, Origin="http://evil.example") == (403, "Origin is not the printed address")


@pytest.mark.parametrize("end", ["console", "viser"])
def test_sockets_need_them_too(played, end):
    from websockets.exceptions import InvalidStatus  # noqa: PLC0415

    wrong = played.control[:-4] + "xxx/"
    for address, origin, status in (
        (played.control, "http://evil.example", 403),
        (played.control, None, 403),
        (wrong, "", 404),
    ):
        with pytest.raises(InvalidStatus, match=str(status)):
            socket(address, end, origin=origin)


def test_however_many_watch_an_operators_page_opens(played):
    from websockets.exceptions import InvalidStatus  # noqa: PLC0415

    with contextlib.ExitStack() as stack:
        for _ in range(24):
            stack.enter_context(socket(played.read_only, close_timeout=0.1))
        with pytest.raises(InvalidStatus, match="503"):
            socket(played.read_only)
        for end in ("console", "viser"):
            stack.enter_context(socket(played.control, end, close_timeout=0.1))


def test_viser_is_not_reachable_beside_it(played):
    """No process of the run listens on any port but the printed one; viser's socket is this user's alone."""
    status = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    status += [line.split() for line in Path("/proc/net/tcp6").read_text().splitlines()[1:]]
    listening = {fields[9]: int(fields[1].rpartition(":")[2], 16) for fields in status if fields[3] == "0A"}
    processes = [played.process.pid, *played.children]
    ports = [listening[inode] for process in processes for inode in open_sockets(process) if inode in listening]
    assert len(processes) == 2
    assert ports == [int(played.authority.rpartition(":")[2])]
    (viser,) = played.runtime.rglob("*.viser")
    assert viser.stat().st_mode & 0o077 == 0
    assert viser.parent.stat().st_mode & 0o077 == 0


def open_sockets(process):
    found = []
    for entry in Path(f"/proc/{process}/fd").iterdir():
        try:
            target = os.readlink(entry)
        except OSError:
            continue
        if target.startswith("socket:["):
            found.append(target[8:-1])
    return found


def test_a_view_cannot_have_the_scene_published(played):
    """viser would reach out for a server on the internet; from this socket only cameras pass."""
    import msgspec  # noqa: PLC0415

    from humanoid_sim.frontends.console.scene import may_pass  # noqa: PLC0415

    assert may_pass(msgspec.msgpack.encode({"type": "ViewerCameraMessage", "wxyz": [1, 0, 0, 0]}))
    for message in ({"type": "ShareUrlRequest"}, {"type": "GuiUpdateMessage"}, {}, [1]):
        assert not may_pass(msgspec.msgpack.encode(message))
    assert not may_pass(b"\xc1")
    assert not may_pass("ViewerCameraMessage")


def test_the_intents_of_a_page_are_granted_and_refused_by_the_session(played):
    with socket(played.control) as page, socket(played.read_only) as other:
        assert until(page, lambda told: "session" in told)["access"] == "control"
        assert until(other, lambda told: "session" in told)["access"] == "read-only"
        refused = ask(page, "start_remote")
        assert refused["granted"] is False
        assert "START_REMOTE refused: requires finished STANDBY" in refused["text"]
        assert ask(page, "damp") == {"granted": True, "text": "DAMP requested"}
        until(page, lambda told: told.get("mode") == "DAMPING")
        assert ask(page, "load_b")["granted"] is True
        told = until(other, lambda told: told.get("mode") == "STANDBY")
        assert told["intents"]["load_a"]["refusal"].startswith("LOAD_A refused: requires DAMPING")
        assert ask(other, "damp") == {"granted": False, "text": "this address is for watching only"}
        assert ask(page, "mark") == {"granted": True, "text": "marked"}
        until(other, lambda told: any("moment 1" in event[2] for event in told.get("events", ())))
        assert until(other, lambda told: "mode" in told)["mode"] == "STANDBY"
        assert ask(page, "reactivate") == {
            "granted": False,
            "text": "REACTIVATE refused: requires ZERO_TORQUE or DAMPING, mode is STANDBY",
        }
        ask(page, "damp")
        until(other, lambda told: told.get("mode") == "DAMPING")


def test_a_page_has_the_robot_enabled_afresh(played):
    """As a relaunch would: the modes begin again at ZERO_TORQUE. A page for watching only cannot."""
    with socket(played.control) as page, socket(played.read_only) as other:
        ask(page, "damp")
        until(page, lambda told: told.get("mode") == "DAMPING")
        assert ask(other, "reactivate") == {"granted": False, "text": "this address is for watching only"}
        assert until(other, lambda told: "mode" in told)["mode"] == "DAMPING"
        answer = ask(page, "reactivate")
        assert answer == {"granted": True, "text": "reactivated: the robot is verified and enabled afresh"}
        until(other, lambda told: told.get("mode") == "ZERO_TORQUE")


@pytest.mark.parametrize(
    ("flood", "refused", "left_out"),
    [
        ({"ask": "load_a"}, {"ask": "start_remote"}, "start_remote left out: more than 5 requests a second"),
        (
            {"do": "press", "key": "0"},
            {"do": "take", "joint": "left_elbow_pitch"},
            "left out: more requests than are taken in a second",
        ),
    ],
    ids=["intents", "wishes"],
)
def test_a_page_that_floods_is_bounded_and_its_damp_is_not(played, flood, refused, left_out):
    """Nor does what waited when the DAMP came move the robot after it."""

    def send(message, count):
        for _ in range(count):
            page.send(json.dumps(message | ({"seen": time.monotonic()} if "ask" in message else {})))

    with socket(played.control) as page:
        ask(page, "damp")
        assert ask(page, "load_a")["granted"] is True
        until(page, lambda told: told.get("mode") == "STANDBY")
        send(flood, 500)
        page.send(json.dumps({"ask": "damp"}))
        until(page, lambda told: told.get("mode") == "DAMPING")
        send(refused, 50 if "ask" in refused else 500)  # in DAMPING, as far as it is asked for at all
        told = until(page, lambda told: any(answer["text"] == left_out for answer in told.get("answers", ())))
        assert told["mode"] == "DAMPING"


def held_bytes(played):
    """A page behind a proxy that holds what it sends; what begins that and what ends it."""
    passing = threading.Event()
    passing.set()
    host, port = played.authority.split(":")
    listener = sockets.create_server(("127.0.0.1", 0))

    def forward(source, target, gate):
        with contextlib.suppress(OSError), source:
            while data := source.recv(65536):
                if gate is not None:
                    gate.wait()
                target.sendall(data)
            target.shutdown(sockets.SHUT_RDWR)

    near = sockets.create_connection(listener.getsockname())
    inner, _ = listener.accept()
    listener.close()
    far = sockets.create_connection((host, int(port)))
    threading.Thread(target=forward, args=(inner, far, passing), daemon=True).start()
    threading.Thread(target=forward, args=(far, inner, None), daemon=True).start()
    return socket(played.control, sock=near), passing.clear, passing.set


@pytest.mark.parametrize("way", ["the console stands still", "the session stands still", "a proxy holds the bytes"])
def test_a_press_that_comes_late_moves_nothing(played, way):
    if way.startswith("a proxy"):
        page, stop, go_on = held_bytes(played)
    else:
        page = socket(played.control)
        stopped = played.children[0] if "console" in way else played.process.pid
        stop, go_on = (lambda number=number: os.kill(stopped, number) for number in (signal.SIGSTOP, signal.SIGCONT))
    with page:
        ask(page, "damp")
        seen = until(page, lambda told: told.get("mode") == "DAMPING")["stamp"]
        stop()
        try:
            page.send(json.dumps({"ask": "load_a", "seen": seen}))
            time.sleep(1.0)
        finally:
            go_on()
        answers = []
        events = []

        def is_told(told):
            answers.extend(told.get("answers", ()))
            events.extend(event[2] for event in told.get("events", ()))
            return any(
                event.startswith(f"{answer['text']}; requested by console") for answer in answers for event in events
            )

        assert until(page, is_told)["mode"] == "DAMPING"
        (answer,) = answers
        assert not answer["granted"]
        assert answer["text"].startswith("LOAD_A refused: too late, it was meant for the robot of ")


def test_a_page_that_does_not_say_what_it_saw_is_told_to_reload(played):
    with socket(played.control) as page:
        ask(page, "damp")
        for seen in ({}, {"seen": None}, {"seen": "now"}, {"seen": -1.0}, {"seen": True}):
            told = answers_to(page, {"ask": "load_a", **seen})
            assert told == "load_a refused: the page does not say what it had seen; reload it"


def test_what_is_not_understood_is_answered(played):
    with socket(played.control) as page:
        for message in ("", "{", "[]", '{"ask": 1}', '{"ask": "fly"}', "[" * 5000, b"\x00\x01"):
            assert answers_to(page, message).startswith("not understood, expected one of damp, load_a"), message


def test_a_new_page_is_told_what_happened_before(played):
    with socket(played.read_only) as page:
        told = until(page, lambda told: told.get("events"))
    assert any("ZERO_TORQUE" in event[2] for event in told["events"])
    assert told["age"] < 0.5


def test_a_wish_is_refused_with_its_reason(played):
    with socket(played.control) as page:
        known = until(page, lambda told: "session" in told)
        assert (known["no_sliders"], known["velocity"]) == ("", None)
        ask(page, "damp")
        until(page, lambda told: told.get("mode") == "DAMPING")
        assert (
            answers_to(page, {"do": "take", "joint": "left_elbow_pitch"}) == "sliders: require REMOTE; mode is DAMPING"
        )
        assert answers_to(page, '{"do": "snap"}') == "sliders: require REMOTE; mode is DAMPING"
        assert answers_to(page, '{"do": "press", "key": "w"}').startswith("velocity: the policy takes no command")
        assert answers_to(page, '{"do": "beat", "seen": NaN}').startswith("not understood: ")
        assert answers_to(page, '{"do": "beat", "seen": 1, "goals": {"position": "1"}}').startswith("not understood: ")


def test_a_page_for_watching_only_moves_nothing(played):
    with socket(played.read_only) as page:
        for wish in ('{"do": "take", "joint": "left_elbow_pitch"}', '{"do": "press", "key": "0"}', '{"do": "let_go"}'):
            assert answers_to(page, wish) == "this address is for watching only"


def rows(page):
    """The next rows of a plot: number of the chart, and the table of times and series."""
    deadline = time.monotonic() + 10.0
    while time.monotonic() < deadline:
        message = page.recv(timeout=5.0)
        if isinstance(message, bytes):
            values = np.frombuffer(message, "<f8")
            return int(values[0]), values[3:].reshape(-1, int(values[1]))
    raise AssertionError("nothing to plot in time")


def test_a_page_plots_what_it_chooses_whoever_opened_it(played):
    with socket(played.read_only) as page:
        charts = until(page, lambda told: "charts" in told)["charts"]
        assert charts[0] == ["position and command", "left_shoulder_pitch", "rad", ["position", "command"]]
        assert {chart[0] for chart in charts} >= {"velocity", "effort", "observation", "tracking error", "loop"}
        page.send(json.dumps({"plot": [0, 30]}))
        assert [rows(page)[0], rows(page)[0]] == [0, 30]
        _, table = rows(page)
        assert np.all(np.diff(table[0]) > 0.015)  # 50 a second, of a loop of 100
        refused = answers_to(page, {"plot": [10_000]})
        assert refused.startswith("plots not understood, expected at most 24 numbers from 0 to ")


def test_a_page_is_told_the_loops_rate_its_recording_and_its_link_to_the_session(played):
    with socket(played.read_only) as page:
        vitals = until(page, lambda told: told.get("vitals", {}).get("rate", [None])[0])["vitals"]
        assert 10.0 < vitals["rate"][0] < 110.0  # the machine may be loaded
        assert vitals["rate"][1] == 100.0
        assert vitals["recording"] == {"file": str(played.folder / "run.mcap"), "error": None}
        assert vitals["base"] is None
        page.send(json.dumps({"ping": ["?"]}))  # not answered
        page.send(json.dumps({"ping": 7}))
        assert until(page, lambda told: "pong" in told) == {"pong": 7}
        os.kill(played.process.pid, signal.SIGSTOP)
        try:
            time.sleep(0.3)
            page.send(json.dumps({"ping": 8}))
            until(page, lambda told: told["age"] > 0.8)
        finally:
            os.kill(played.process.pid, signal.SIGCONT)
        assert until(page, lambda told: "pong" in told) == {"pong": 8}  # after the session's next tick, not before


def test_a_page_that_does_not_read_slows_no_other(played):
    """The console sends it what fits into its socket, and drops the rest in favour of what is newer."""
    with socket(played.control, max_queue=1, close_timeout=0.1) as stuck, socket(played.read_only) as page:
        stuck.send(json.dumps({"plot": [0, 14, 28, 42, 43, 46, 47, 48]}))
        began, ages, times = time.monotonic(), [], []
        while time.monotonic() - began < 1.5:
            told = until(page, lambda told: "age" in told)
            ages.append(told["age"])
            times.append(told["time"])
        assert np.median(ages) < 0.5
        assert times[-1] - times[0] > 0.2
        page.send(json.dumps({"plot": [0]}))
        assert rows(page)[1].shape[0] == 3


def test_the_figures_in_the_view_are_switched_for_all_pages_by_an_operator_alone(played):
    with socket(played.control) as page, socket(played.read_only) as other:
        figures = until(other, lambda told: "figures" in told)["figures"]
        assert (figures["reference"]["on"], figures["command"]["on"]) == (True, False)
        assert answers_to(other, {"show": "command", "on": True}) == "this address is for watching only"
        page.send(json.dumps({"show": "command", "on": True}))
        until(other, lambda told: told.get("figures", {}).get("command", {}).get("on"))
        for wrong in ({"show": "command", "on": 1}, {"show": ["command"], "on": True}, {"show": "halo", "on": True}):
            assert answers_to(page, wrong).startswith("show")
        page.send(json.dumps({"show": "command", "on": False}))
        until(other, lambda told: told.get("figures", {"command": {"on": True}})["command"]["on"] is False)


def test_a_page_loads_a_policy_and_every_page_begins_anew_with_it(played):
    """From here on the session has another motion."""
    with socket(played.control) as page, socket(played.read_only) as other:
        unknown = {"load": {"policy": "nothing.onnx"}, "seen": time.monotonic()}
        assert answers_to(page, unknown).startswith("load refused: ")
        for message in ({"load": 3}, {"load": {"robot": "x"}}):
            assert answers_to(page, message).startswith("load not understood")
        assert answers_to(other, {"load": {"policy": "lite_tracking"}}) == "this address is for watching only"
        ask(page, "damp")
        chosen = {"policy": "lite_tracking", "motion": "circle", "command": ""}
        page.send(json.dumps({"load": chosen, "seen": time.monotonic()}))
        told = {}
        deadline = time.monotonic() + 120.0
        while not told.get("answers") or "page" not in told:
            assert time.monotonic() < deadline
            message = page.recv(timeout=30.0)
            told |= {} if isinstance(message, bytes) else {k: v for k, v in json.loads(message).items() if v}
        answers = told["answers"]
        assert answers[0]["granted"], answers
        assert "motion circle.mcap" in answers[0]["text"]
        assert told["policy"].endswith("lite_tracking.onnx")
        assert until(other, lambda told: "page" in told)["policy"] == told["policy"]


def test_a_marked_moment_is_an_event_of_the_recording_which_replays(played):
    """The last test of this run: it ends here."""
    with socket(played.control) as page:
        ask(page, "damp")
        until(page, lambda told: told.get("mode") == "DAMPING")
        assert ask(page, "mark")["granted"] is True
        with socket(played.read_only) as late:
            told = until(late, lambda told: told.get("events"))
        marked, text = next(event[1:] for event in reversed(told["events"]) if "mark of console" in event[2])
        assert ask(page, "quit")["granted"] is True
    assert played.process.wait(timeout=20.0) == 0
    recording = open_recording(played.folder / "run.mcap")
    marks = [entry for entry in recording.entries() if isinstance(entry, Event) and "mark of console" in entry.text]
    assert (marks[-1].time, marks[-1].text) == (marked, text)
    assert text.endswith(f"moment {len(marks)}")
    times = [record.input.state.time for record in recording.ticks()]
    assert times[0] < marked < times[-1]
    assert run_program(replay.main, [str(played.folder / "run.mcap")]) == 0
