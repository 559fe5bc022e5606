import importlib.util
import subprocess

import pytest

from humanoid_sim.cli import parse
from humanoid_sim.errors import InputError, MissingPackageError
from humanoid_sim.frontends import Wanted
from humanoid_sim.play import front_ends
from humanoid_sim.play.front_ends import look_for_gamepad, wanted_front_ends
from humanoid_sim.play.options import PlayConfig
from humanoid_sim.ros2.dds import domain


@pytest.mark.parametrize(
    ("options", "needed"),
    [
        ({}, False),
        ({"gamepad": ()}, True),
        ({"hardware": "virtual:a"}, False),
        ({"hardware": "udp_multicast:239.74.163.2"}, False),
        ({"hardware": "virtual:a", "gamepad": ()}, True),
        ({"hardware": "can0"}, True),
        ({"hardware": "can0,can1", "no_gamepad": True}, False),
        ({"hardware": "can0", "dry_run": True}, False),
    ],
)
def test_a_gamepad_is_needed_on_a_real_bus_and_where_it_is_asked_for(options, needed):
    assert PlayConfig(**options).needs_gamepad is needed


def test_a_real_bus_without_a_gamepad_is_refused(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: object())
    answer = subprocess.CompletedProcess([], 1, stdout="no gamepad is plugged in\n", stderr="")
    monkeypatch.setattr(front_ends.subprocess, "run", lambda *_, **__: answer)
    with pytest.raises(InputError, match=r"^--hardware: no gamepad is plugged in; plug one in .* or say --no-gamepad$"):
        look_for_gamepad(PlayConfig(hardware="can0"))
    assert look_for_gamepad(PlayConfig(gamepad=())) == ("gamepad: no gamepad is plugged in",)
    answer.returncode = 0
    answer.stdout = "Pad (12 buttons, unknown layout); down: none; its buttons have their driver's numbers\n"
    assert look_for_gamepad(PlayConfig(hardware="can0")) == (f"gamepad: {answer.stdout.strip()}",)
    assert look_for_gamepad(PlayConfig()) == ()
    assert [wanted.name for wanted in wanted_front_ends(PlayConfig(hardware="can0"))] == ["gamepad"]


def test_the_gamepad_of_play_has_the_layout_of_its_options_or_its_file(monkeypatch, tmp_path):
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: object())
    options = ("--joy.damp-button", "3", "--joy.load-combo-a", "4", "1", "--joy.load-combo-b", "4", "0")
    given = parse(PlayConfig, "play", ["--gamepad", *options])
    assert wanted_front_ends(given) == (Wanted("gamepad", options),)
    file = tmp_path / "pad.yaml"
    file.write_text("joy: {damp_button: 3, load_combo_a: [4, 1], load_combo_b: [4, 0]}\n")
    from_file = parse(PlayConfig, "play", ["--gamepad", str(file)])
    assert wanted_front_ends(from_file) == (Wanted("gamepad", options),)
    with pytest.raises(InputError, match=r"^--gamepad and --joy.damp-button: both bind the buttons"):
        wanted_front_ends(parse(PlayConfig, "play", ["--gamepad", str(file), "--joy.damp-button", "3"]))
    on_a_bus = parse(PlayConfig, "play", ["--hardware", "can0", "--joy.damp-button", "3"])
    assert wanted_front_ends(on_a_bus) == (Wanted("gamepad", ("--joy.damp-button", "3")),)


def test_a_front_end_whose_package_is_missing_is_refused(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    with pytest.raises(MissingPackageError, match="rtmidi"):
        wanted_front_ends(PlayConfig(midi=()))


def test_an_interface_for_another_machine_has_a_bridge_of_its_own(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: object())
    monkeypatch.setattr(domain.socket, "if_nameindex", lambda: [(1, "lo"), (2, "eth1")])
    assert [(one.name, one.options, one.label) for one in wanted_front_ends(PlayConfig(dds=("eth1",)))] == [
        ("dds", (), ""),
        ("dds", ("--interface", "eth1"), "dds eth1"),
    ]
    for name in ("eth7", "lo"):
        with pytest.raises(InputError, match=rf"^--dds: unknown network interface .* '{name}'.*; known: eth1$"):
            wanted_front_ends(PlayConfig(dds=(name,)))


@pytest.mark.parametrize(
    ("named", "options"),
    [
        ((), ()),
        (("Keystation",), ("--port", "Keystation")),
        (("/dev/snd/midiC1D0",), ("--device", "/dev/snd/midiC1D0")),
    ],
)
def test_a_midi_keyboard_is_named_by_its_port_or_its_device(named, options, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: object())
    (wanted,) = wanted_front_ends(PlayConfig(midi=named))
    assert (wanted.name, wanted.options) == ("midi", options)
    with pytest.raises(InputError, match=r"^--midi: is one two, expected one port or device$"):
        wanted_front_ends(PlayConfig(midi=("one", "two")))


def test_only_a_port_needs_the_library(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    assert [one.name for one in wanted_front_ends(PlayConfig(midi=("./keys",)))] == ["midi"]
    with pytest.raises(MissingPackageError, match=r"rtmidi.*humanoid_sim\[midi\]"):
        wanted_front_ends(PlayConfig(midi=()))
