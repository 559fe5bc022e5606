"""The six services, called by ROS 2's own client."""

import json
import signal
import threading
import time

import pytest
from machines import play, read_until, serve

pytestmark = pytest.mark.ros

TYPES = ["std_srvs/srv/Trigger"]
SERVICES = [
    [f"/humanoid_control/mode/{word}", TYPES]
    for word in ("damp", "load_a", "load_b", "quit", "start_locomotion", "start_remote")
]


class Caller:
    """A ROS 2 client that stays."""

    def __init__(self, machine, **environment):
        self._program = machine.ros("trigger.py", "call", environment=environment)
        read_until(self._program, "ready")

    def __call__(self, word):
        self._program.stdin.write(word + "\n")
        self._program.stdin.flush()
        while not (line := self._program.stdout.readline()).startswith("["):
            assert line, "the client has ended"  # what Fast DDS logs comes in between
        return json.loads(line)

    def until_granted(self, word):
        """Call until it is granted; every refusal is for the pose that is not reached yet."""
        for _ in range(300):
            granted, message = self(word)
            if granted:
                return str(message)
            assert "requires finished STANDBY" in message
            time.sleep(0.1)
        raise AssertionError(f"{word}: {message}")


@pytest.fixture(scope="module")
def services(robot):
    return serve(robot)


def test_all_six_drive_the_fsm_with_its_own_answers(robot, services):
    call = Caller(robot)
    assert json.loads(robot.ask_ros("trigger.py", "list", "6", "10")) == SERVICES
    assert call("damp") == [False, "no session is running; start one with play"]
    session = play(robot)
    read_until(session, "ZERO_TORQUE  started")
    assert call("load_a") == [
        False,
        "ZERO_TORQUE (zero_torque_controller): LOAD_A refused: requires DAMPING, mode is ZERO_TORQUE",
    ]
    assert call("damp") == [True, "DAMPING (damping_controller): DAMP requested"]
    assert call("start_remote")[0] is False
    assert call("load_a") == [True, "STANDBY (standby_controller_a): LOAD_A requested"]
    assert call.until_granted("start_locomotion") == "LOCOMOTION (rl_policy_controller): START_LOCOMOTION requested"
    assert call("damp")[0] is True
    assert call("load_b") == [True, "STANDBY (standby_controller_b): LOAD_B requested"]
    assert call.until_granted("start_remote") == "REMOTE (remote_policy_controller): START_REMOTE requested"
    granted, message = call("quit")
    assert not granted
    assert "QUIT refused: requires ZERO_TORQUE or DAMPING, mode is REMOTE" in message
    assert call("damp")[0] is True
    later = threading.Timer(1.0, services.send_signal, (signal.SIGCONT,))
    services.send_signal(signal.SIGSTOP)
    later.start()
    granted, message = call("load_a")
    assert not granted
    assert message.startswith("LOAD_A refused: too late")
    time.sleep(1.0)
    assert call("quit")[0] is True
    assert session.wait(30.0) == 0
    assert services.poll() is None
    assert call("damp") == [False, "no session is running; start one with play"]


@pytest.mark.parametrize(
    "environment",
    [{}, {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}, {"ROS_LOCALHOST_ONLY": "1"}],
    ids=["default", "localhost", "localhost_only"],
)
def test_every_client_of_this_machine_finds_them(robot, services, environment):
    listed = robot.ask_ros("trigger.py", "list", "6", "15", environment=environment)
    assert json.loads(listed.splitlines()[-1]) == SERVICES
