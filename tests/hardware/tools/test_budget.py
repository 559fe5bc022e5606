import pytest

from humanoid_sim.hardware.tools.budget import channel_budgets
from humanoid_sim.robots.description import load_robot

_LITE = load_robot("lite")


def test_the_protocols_figures_for_one_bus_at_200_hz_and_two_that_share_the_motors():
    (channel,) = channel_budgets(_LITE, 1, 200.0, 1e6, 0.0)
    assert channel.frames == 14
    assert channel.period_time == pytest.approx((3.668e-3, 4.48e-3))
    assert channel.load == pytest.approx((0.7336, 0.896))
    assert channel.highest_rate == pytest.approx((272.6, 223.2), abs=0.1)
    left, right = channel_budgets(_LITE, 2, 200.0, 1e6, 0.0)
    assert (left.joints, right.joints) == (_LITE.joint_names[:7], _LITE.joint_names[7:])
    assert left.load == pytest.approx((0.3668, 0.448))


def test_reports_take_their_share():
    (channel,) = channel_budgets(_LITE, 1, 50.0, 1e6, 100.0)
    assert channel.load[1] == pytest.approx(14 * (2 * 50 + 100) * 160e-6)
    assert channel.highest_rate[1] == pytest.approx((1.0 / (14 * 160e-6) - 100.0) / 2.0)
    (full,) = channel_budgets(_LITE, 1, 50.0, 125e3, 100.0)
    assert full.highest_rate[1] == 0.0
    assert full.load[1] > 1.0


def test_both_layouts_are_shown_with_the_diagnosis(run):
    status, printed, complained = run("budget", "--rate", "200", "--no-reports")
    assert (status, complained) == (0, "")
    assert printed.startswith("lite on 1 channel at 200 Hz ")
    assert "73–90 %" in printed
    assert "tight: a repeated frame delays the next period" in printed
    assert "37–45 %" in printed
    assert "ENOBUFS" in printed
    assert "a period sends 14 at once: sudo ip link set CHANNEL txqueuelen 100" in printed


def test_status_1_where_it_does_not_fit_and_a_channels_name_as_it_is(run):
    status, printed, _ = run("budget", "--channels", "virtual::bus:[b]", "--rate", "300")
    assert status == 1
    assert "virtual::bus:[b]" in printed
    assert "does not fit" in printed


def test_a_sito_motor_takes_two_frames_each_way_and_sends_no_reports():
    (mixed,) = channel_budgets(load_robot("lite_sito"), 1, 50.0, 1e6, 100.0)
    assert (mixed.frames, mixed.reporting) == (18, 10)
    assert mixed.load == pytest.approx(tuple((36 * 50.0 + 10 * 100.0) * time for time in (131e-6, 160e-6)))
    (lite,) = channel_budgets(load_robot("lite"), 1, 50.0, 1e6, 100.0)
    assert lite.load[0] == pytest.approx((28 * 50.0 + 14 * 100.0) * 131e-6)
