"""Foxglove's server, by a client that speaks its protocol (WebSocket, subprotocol foxglove.sdk.v1)."""

import json
import signal
import socket
import struct
import subprocess
import sys
import time
from contextlib import contextmanager

import pytest
from dds_bridge import program
from local_session import ticking

from humanoid_sim.client import Feed
from humanoid_sim.errors import InputError
from humanoid_sim.foxglove import main, service_words
from humanoid_sim.frontends import Wanted
from humanoid_sim.messages import ControlMode, Mode, TickInput, TickOutput, TickRecord
from humanoid_sim.mit import MITCommand, MITState
from humanoid_sim.play.front_ends import wanted_front_ends
from humanoid_sim.play.options import PlayConfig
from humanoid_sim.robots.description import load_robot
from humanoid_sim.session.feed import MODEL_BLOB
from humanoid_sim.simulation.model import build_model, model_bytes
from humanoid_sim.stack import run_header

pytest.importorskip("foxglove", reason="foxglove-sdk is not installed (foxglove)")
client = pytest.importorskip("websockets.sync.client", reason="websockets is not installed")


@contextmanager
def served(*options):
    """`python -m humanoid_sim.foxglove` on a free port, once it listens."""
    says = "open a connection to ws://127.0.0.1:"
    with program("foxglove", "--port", "0", *options, says=says) as (process, line):
        yield int(line.removeprefix(says).partition(",")[0]), process


class Client:
    def __init__(self, port):
        # As a page of a foreign origin would.
        self._socket = client.connect(
            f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"], origin="http://foreign.example"
        )
        self.channels = {}
        self.services = {}
        self.statuses = []
        self.data = {}
        self.answers = {}

    def until(self, condition):
        deadline = time.monotonic() + 30.0
        while not condition():
            assert time.monotonic() < deadline, (list(self.channels), self.services, self.statuses)
            try:
                self._take(self._socket.recv(timeout=0.2))
            except TimeoutError:
                continue

    def _take(self, message):
        if isinstance(message, str):
            document = json.loads(message)
            for channel in document.get("channels", ()):
                self.channels[channel["topic"]] = channel
            for service in document.get("services", ()):
                self.services[service["name"]] = service["id"]
            if document["op"] == "status":
                self.statuses.append(document["message"])
        elif message[0] == 1:
            self.data[struct.unpack_from("<I", message, 1)[0]] = message[13:]
        elif message[0] == 3:
            _, call, length = struct.unpack_from("<III", message, 1)
            self.answers[call] = json.loads(message[13 + length :])

    def subscribe(self, number, topic):
        """Until it has brought something: a server that has just begun may name a channel before it knows it."""
        self.until(lambda: topic in self.channels)
        asked = 0.0

        def is_served():
            nonlocal asked
            if time.monotonic() > asked + 2.0:
                asked = time.monotonic()
                subscription = {"id": number, "channelId": self.channels[topic]["id"]}
                self._socket.send(json.dumps({"op": "subscribe", "subscriptions": [subscription]}))
            return number in self.data

        self.until(is_served)

    def call(self, name, meanwhile=lambda: None):
        self.until(lambda: name in self.services)
        self._socket.send(b"\x02" + struct.pack("<III", self.services[name], 5, 4) + b"json{}")
        meanwhile()
        self.until(lambda: 5 in self.answers)
        return self.answers.pop(5)

    def close(self):
        self._socket.close()


def test_a_button_pressed_while_it_stood_still_moves_nothing_and_damp_damps(local, page):
    with served("--control") as (port, process), ticking(local) as records:
        foxglove = page(port)

        def go_on():
            time.sleep(0.7)
            process.send_signal(signal.SIGCONT)

        def pressed(name):
            foxglove.until(lambda: name in foxglove.services)
            process.send_signal(signal.SIGSTOP)
            return foxglove.call(name, go_on)

        assert foxglove.call("/damp")["success"]
        answer = pressed("/load_a")
        assert not answer["success"]
        assert "LOAD_A refused: too late, it was meant for the robot of" in answer["message"]
        assert records[-1].output.control_mode.mode is Mode.DAMPING
        assert pressed("/damp")["success"]
        time.sleep(0.7)
        assert foxglove.call("/load_a")["success"]


@pytest.fixture
def page():
    clients = []

    def connect(port):
        clients.append(Client(port))
        return clients[-1]

    yield connect
    for each in clients:
        each.close()


def test_it_serves_the_recordings_topics_and_damps_but_nothing_else(local, page):
    with served() as (port, process):
        with ticking(local) as records:
            _look_and_damp(local, page(port), records)
        local.feed.close()
        assert process.wait(5.0) == 0


def _look_and_damp(local, foxglove, records):
    foxglove.subscribe(1, "/humanoid_sim/tick")
    foxglove.subscribe(2, "/three/joint_states")
    channel = foxglove.channels["/three/joint_states"]
    assert (channel["encoding"], channel["schemaName"], channel["schemaEncoding"]) == (
        "cdr",
        "sensor_msgs/msg/JointState",
        "ros2msg",
    )
    assert b"elbow" in foxglove.data[2]
    with Feed(local.info) as feed:
        assert foxglove.data[1] in [sample.data for sample in feed.since(0)]
    assert list(foxglove.services) == ["/damp"]
    assert records[-1].output.control_mode.mode is Mode.ZERO_TORQUE
    assert foxglove.call("/damp")["success"] is True
    foxglove.until(lambda: records[-1].output.control_mode.mode is Mode.DAMPING)


@pytest.mark.slow
def test_with_control_it_offers_every_intent_with_a_warning(local, page):
    with served("--control") as (port, process), ticking(local) as records:
        assert process.stdout.readline().startswith("WARNING: every page open in a browser on this machine can move")
        foxglove = page(port)
        assert foxglove.call("/start_remote")["success"] is False  # as anybody's who asks too early
        assert foxglove.call("/damp")["success"] is True
        assert foxglove.call("/load_a")["success"] is True
        assert records[-1].output.control_mode.mode is Mode.STANDBY


@pytest.mark.slow
def test_a_late_subscriber_gets_the_robots_description_and_a_loop_that_stands_still_is_told(local, page):
    lite = load_robot("lite")
    header = run_header(lite, 0.005, None, settings={})
    local.publish(header, {MODEL_BLOB: model_bytes(build_model(lite))}, robot="lite")
    output = TickOutput(MITCommand.zeros(14), ControlMode(Mode.DAMPING, "damping_controller"))
    local.feed.tick(TickRecord(0, TickInput(MITState.unknown(14, 1.0)), output, 0.0, False))
    with served() as (port, _):
        foxglove = page(port)
        foxglove.until(lambda: "/robot_description" in foxglove.channels)
        time.sleep(0.5)
        foxglove.subscribe(3, "/robot_description")
        foxglove.until(lambda: 3 in foxglove.data)
        assert b'<robot name="lite"' in foxglove.data[3]
        assert all(name.encode() in foxglove.data[3] for name in lite.joint_names)
        foxglove.until(lambda: any(text.startswith("session: BEHIND: this was ") for text in foxglove.statuses))


def test_a_port_that_cannot_be_is_refused(local):
    with pytest.raises(InputError, match=r"^--port: is 70000, expected 0 to 65535$"):
        main(["--port", "70000"])


@pytest.mark.slow
def test_a_port_that_is_taken_is_refused(local):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        # In a process of its own: the library leaves threads behind.
        command = [sys.executable, "-m", "humanoid_sim.foxglove", "--port", str(port)]
        done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"error: --port: {port} on 127.0.0.1 cannot be had: ")
    assert done.stderr.count("\n") == 1


def test_options():
    assert service_words(control=False) == ("damp",)
    assert service_words(control=True)[1:] == ("load_a", "load_b", "start_locomotion", "start_remote", "quit")
    assert wanted_front_ends(PlayConfig(viewer="none", foxglove=True)) == (Wanted("foxglove"),)
    both = PlayConfig(viewer="none", foxglove_control=True)
    assert wanted_front_ends(both) == (Wanted("foxglove", ("--control",)),)
