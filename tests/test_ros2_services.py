"""What the ROS 2 services do without ROS 2; with it they are tested in `tests/ros2_live`."""

import ast
import itertools
import os
import shutil
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import pytest
from local_session import ticking

from humanoid_sim import client, ros2_services
from humanoid_sim.ros2_services import SERVICES, answer, loopback_environment

FILE = Path(ros2_services.__file__)


def told(local, word, process=None, **options):
    """The answer of a session that ticks meanwhile."""
    with ticking(local):
        return answer(word, process, **options)


def test_the_names_are_those_of_the_original():
    words = ("damp", "load_a", "load_b", "start_remote", "start_locomotion", "quit")
    assert {f"/humanoid_control/mode/{word}": word for word in words} == SERVICES


def test_the_answer_is_that_of_the_fsm(local):
    granted, text = told(local, "start_remote")
    assert not granted
    assert text.endswith("START_REMOTE refused: requires finished STANDBY, mode is ZERO_TORQUE")
    assert told(local, "damp")[0]
    granted, text = told(local, "load_b", client.find_session().process)
    assert granted
    assert "STANDBY (standby_controller_b)" in text


def test_a_damp_of_several_succeeds_if_all_are_damped(local, monkeypatch):
    granted = (local.info, client.Answer(True, "DAMPING"))
    silent = (local.info, client.SessionError("did not answer"))
    for answers, expected in (([granted, granted], True), ([granted, silent], False)):
        monkeypatch.setattr(ros2_services, "ask_sessions", lambda *_, answers=answers, **__: iter(answers))
        succeeded, text = answer("damp", None)
        assert succeeded is expected
        assert text.startswith("DAMPING; ")


def test_each_middleware_is_kept_on_this_machine_or_refused(tmp_path):
    profiles = tmp_path / "profiles.xml"
    fast = loopback_environment("rmw_fastrtps_cpp", profiles)
    assert fast["FASTDDS_DEFAULT_PROFILES_FILE"] == fast["FASTRTPS_DEFAULT_PROFILES_FILE"] == str(profiles)
    assert fast["ROS_STATIC_PEERS"] is None
    assert "<interfaceWhiteList><address>127.0.0.1</address></interfaceWhiteList>" in profiles.read_text()
    assert "<useBuiltinTransports>false</useBuiltinTransports>" in profiles.read_text()
    cyclone = loopback_environment("rmw_cyclonedds_cpp", profiles)
    assert '<NetworkInterface name="lo" multicast="true"/>' in (cyclone["CYCLONEDDS_URI"] or "")
    for other in ("rmw_zenoh_cpp", "rmw_connextdds", ""):
        with pytest.raises(client.SessionError, match=r"expected rmw_fastrtps_cpp or rmw_cyclonedds_cpp$"):
            loopback_environment(other, profiles)


def test_the_two_files_work_without_the_package(tmp_path):
    for file in (FILE, Path(client.__file__)):
        shutil.copy(file, tmp_path)
        ast.parse(file.read_text(encoding="utf-8"), feature_version=(3, 9))
    command = [sys.executable, "-S", str(tmp_path / FILE.name)]  # without the packages that are installed
    run = subprocess.run(command, capture_output=True, text=True, env={}, check=False)
    assert run.returncode == 2
    assert run.stderr.startswith("error: No module named 'rclpy': source /opt/ros/")


def test_a_call_that_waited_while_another_was_answered_is_no_newer_than_that(monkeypatch, tmp_path):
    found, services, answered, clock = iter(["damp", "load_a", "", "load_b"]), {}, [], itertools.count(1)
    left = [3]  # turns

    def spin_once(timeout_sec):
        word = next(found, "")
        if word:
            services[word](None, SimpleNamespace())

    def ok():
        left[0] -= 1
        return left[0] >= 0

    node = SimpleNamespace(
        create_service=lambda _, name, callback: services.setdefault(name.rpartition("/")[2], callback),
        context=SimpleNamespace(get_domain_id=lambda: 0),
    )
    executor = SimpleNamespace(add_node=lambda _: None, spin_once=spin_once)
    modules = {
        "rclpy": {"init": lambda **_: None, "ok": ok, "create_node": lambda *_, **__: node, "try_shutdown": list},
        "rclpy.executors": {"ExternalShutdownException": KeyError, "SingleThreadedExecutor": lambda: executor},
        "rclpy.utilities": {"get_rmw_implementation_identifier": lambda: "rmw_cyclonedds_cpp"},
        "std_srvs": {},
        "std_srvs.srv": {"Trigger": None},
    }
    for name, fields in modules.items():
        monkeypatch.setitem(sys.modules, name, SimpleNamespace(**fields))
    monkeypatch.setattr(os, "environ", dict(os.environ))
    monkeypatch.setattr(ros2_services, "network_on", lambda _: nullcontext())
    monkeypatch.setattr(ros2_services, "monotonic_ns", lambda: next(clock))
    monkeypatch.setattr(ros2_services, "answer", lambda word, _, seen: answered.append((word, seen)) or (True, ""))
    ros2_services._serve(None, tmp_path / "profiles.xml")
    (damp, first), (load_a, second), (load_b, third) = answered
    assert (damp, load_a, load_b) == ("damp", "load_a", "load_b")
    assert first == second < third
