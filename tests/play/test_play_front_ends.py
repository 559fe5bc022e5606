import pytest
from fake_pads import FakePads

from humanoid_sim.cli import parse
from humanoid_sim.errors import InputError
from humanoid_sim.play import front_ends
from humanoid_sim.play.front_ends import look_for_gamepad, wanted_front_ends
from humanoid_sim.play.options import PlayConfig


def test_a_gamepad_is_needed_on_a_real_bus_and_where_it_is_asked_for(monkeypatch, tmp_path):
    pads = FakePads(tmp_path)
    monkeypatch.setattr(front_ends, "Pads", lambda: pads)
    for options in (
        {},
        {"hardware": "udp_multicast:239.74.163.2"},
        {"hardware": "can0,can1", "no_gamepad": True},
        {"hardware": "can0", "dry_run": True},
    ):
        assert look_for_gamepad(PlayConfig(**options)) == []
    assert look_for_gamepad(PlayConfig(gamepad=()))[0].startswith("gamepad: no gamepad is plugged in")
    with pytest.raises(InputError, match=r"^--hardware: no gamepad is plugged in, .*; plug one in .*, or say --no-gam"):
        look_for_gamepad(PlayConfig(hardware="can0"))
    pads.plug()
    assert look_for_gamepad(PlayConfig(hardware="can0")) == ["gamepad: Test Pad"]
    assert wanted_front_ends(PlayConfig(hardware="can0")) == (("gamepad",),)
    assert wanted_front_ends(PlayConfig(hardware="can0", no_gamepad=True)) == ()


def test_the_gamepad_of_play_has_the_layout_of_its_file():
    given = parse(PlayConfig, "play", ["--gamepad", "pad.yaml"])
    assert wanted_front_ends(given) == (("gamepad", "--mapping", "pad.yaml"),)
    with pytest.raises(InputError, match=r"^--gamepad: is one two, expected one file"):
        wanted_front_ends(PlayConfig(gamepad=("one", "two")))


def test_an_interface_for_another_machine_has_a_bridge_of_its_own(monkeypatch):
    monkeypatch.setattr("socket.if_nameindex", lambda: [(1, "lo"), (2, "eth1")])
    assert wanted_front_ends(PlayConfig(dds=("eth1",))) == (("dds",), ("dds", "--interface", "eth1"))
    assert wanted_front_ends(PlayConfig(dds=("lo",))) == wanted_front_ends(PlayConfig(dds=())) == (("dds",),)
    with pytest.raises(InputError, match=r"^--dds: unknown network interface 'eth2'"):
        wanted_front_ends(PlayConfig(dds=("eth2",)))
