"""An operator's devices: a gamepad that is lost damps, and without an intent or a token nobody moves anything."""

import os
import signal
import time
from http.client import HTTPConnection
from pathlib import Path

import numpy as np
import pytest
from session_surface import JOINTS, PAGE_SOCKET, PERIOD, REST_POSITION, Conditions, pad_desk, page_address, play

from humanoid_sim.messages import Intent, Mode
from humanoid_sim.mit import MITState

PLACEHOLDER = ("--policy", "placeholder")


# The gamepad.


class Robot:
    """Joints at rest."""

    joints = JOINTS

    def __init__(self):
        self.commands = []

    def activate(self): ...

    def close(self): ...

    def read(self):
        n, imu = len(JOINTS), (np.array([1.0, 0, 0, 0]), np.zeros(3), np.array([0, 0, 9.81]))
        return MITState(len(self.commands) * PERIOD, REST_POSITION, *np.zeros((3, n)), *imu), ()

    def write(self, command):
        self.commands.append(command)


@pytest.fixture
def desk(runtime):
    with pad_desk(Robot()) as found:
        yield found


def test_a_gamepad_damps_and_leads_to_standby(desk):
    desk.plug()
    assert desk.tick() is Mode.ZERO_TORQUE
    assert desk.press("L1", "A") is Mode.ZERO_TORQUE, "LOAD is refused without torque"
    assert desk.press("X") is Mode.DAMPING
    assert desk.press("L1", "A") is Mode.STANDBY
    assert desk.press("X") is Mode.DAMPING


@pytest.mark.parametrize("held", [("L1", "A"), ("L1", "B"), ("BACK",)])
def test_a_button_that_is_down_when_the_gamepad_comes_is_no_intent(held, desk):
    desk.plug()
    desk.press("X")
    desk.unplug()
    desk.tick(5)
    desk.plug(held=held)
    assert desk.tick(5) is Mode.DAMPING
    assert not desk.has_quit


def test_a_gamepad_that_is_unplugged_damps(desk):
    desk.plug()
    desk.press("X")
    desk.press("L1", "A")
    assert desk.tick(30) is Mode.STANDBY
    desk.unplug()
    assert desk.tick(15) is Mode.DAMPING, "within 0.3 s"


def test_a_gamepad_whose_program_hangs_damps_and_nothing_is_driven_without_it(desk):
    desk.plug()
    desk.press("X")
    desk.press("L1", "A")
    assert desk.tick(5, program_runs=False) is Mode.STANDBY
    assert desk.tick(10, program_runs=False) is Mode.DAMPING, "within 0.3 s"
    desk.ask(Intent.LOAD_A)
    assert desk.tick(3, program_runs=False) is Mode.DAMPING
    desk.tick(5)
    desk.ask(Intent.LOAD_A)
    assert desk.tick(30) is Mode.STANDBY, "it is there again"


def test_an_unknown_gamepad_drives_nothing(desk):
    desk.plug(is_known=False)
    desk.tick()
    desk.ask(Intent.DAMP)
    desk.tick(5)
    for first in range(6):
        for second in range(6):
            assert desk.press(first, second) is Mode.DAMPING
    assert not desk.has_quit


# On hardware, and from a browser.


def listening():
    """Ports on which this process or a child of it accepts connections."""
    ports = {}
    for table in ("tcp", "tcp6"):
        for line in Path("/proc/net", table).read_text().splitlines()[1:]:
            _, local, _, state, *_, inode = line.split()[:10]
            if state == "0A":  # LISTEN
                ports[f"socket:[{inode}]"] = int(local.rpartition(":")[2], 16)
    children = [number for path in Path("/proc/self/task").glob("*/children") for number in path.read_text().split()]
    handles = [handle for number in ("self", *children) for handle in Path("/proc", number, "fd").iterdir()]
    return {ports[target] for target in map(os.readlink, filter(os.path.islink, handles)) if target in ports}


def test_on_hardware_nothing_moves_without_an_intent_and_no_page_is_opened(quick):
    before, opened = listening(), []

    def operator():
        for _ in range(60):
            yield
        opened.append(listening() - before)

    run = play("--robot", quick, "--hardware", "virtual:quiet", operator=leaving(operator()))
    assert len(run.ticks) > 60
    for tick in run.ticks:
        assert tick.output.control_mode.mode is Mode.ZERO_TORQUE
        for name in ("velocity", "effort", "stiffness", "damping"):
            assert not getattr(tick.output.command, name).any()
    assert opened == [set()]


def test_without_being_asked_for_a_simulation_opens_no_page_either(quick):
    before, opened = listening(), []

    def operator():
        yield
        opened.append(listening() - before)

    play("--robot", quick, *PLACEHOLDER, "--script", "damp; hold 0.1", operator=operator())
    assert opened == [set()]


def answer(port, path, **headers):
    """Status of the answer to a request for a page."""
    connection = HTTPConnection("127.0.0.1", port, timeout=30.0)
    connection.putrequest("GET", path, skip_host="Host" in headers)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    status = connection.getresponse().status
    connection.close()
    return status


def test_the_page_is_opened_when_asked_for_and_with_its_token_alone(quick):
    around = Conditions()
    upgrade = {"Connection": "Upgrade", "Upgrade": "websocket", "Sec-WebSocket-Version": "13"}
    upgrade["Sec-WebSocket-Key"] = "dGhlIHNhbXBsZSBub25jZQ=="

    def operator():
        while (found := page_address(around.out())) is None:
            yield
            time.sleep(0.01)
        port, path, token = found
        assert len(token) >= 16
        assert port in listening()
        assert answer(port, path) == 200
        for other in ("", token[:-1], token[::-1]):
            assert answer(port, path.replace(token, other)) in (401, 403, 404)
        assert answer(port, "/") in (401, 403, 404)
        assert answer(port, path, Host="somewhere.else") in (401, 403, 404), "a name that leads to this machine"
        link = path + PAGE_SOCKET
        assert answer(port, link, Origin=f"http://127.0.0.1:{port}", **upgrade) == 101
        assert answer(port, link, Origin="http://somewhere.else", **upgrade) in (401, 403, 404), "another site's page"
        assert answer(port, f"/{PAGE_SOCKET}", Origin=f"http://127.0.0.1:{port}", **upgrade) in (401, 403, 404)

    options = ("--script", "damp; hold 600", "--duration", "300", "--console")
    run = play("--robot", quick, *PLACEHOLDER, *options, operator=leaving(operator()), around=around)
    assert run.status == 143


def leaving(operator):
    """End the run when an operator is done."""
    yield from operator
    os.kill(os.getpid(), signal.SIGTERM)
