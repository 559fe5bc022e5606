"""MuJoCo's one handler of warnings, lent to simulations."""

import mujoco
import pytest

from humanoid_sim.robots.silence import mujoco_silenced


def step_into_trouble():
    """A position that is not a number; returns how often MuJoCo has warned of it."""
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='1'/></body></worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    data.qpos[0] = float("nan")
    mujoco.mj_step(model, data)
    return int(data.warning[mujoco.mjtWarning.mjWARN_BADQPOS].number)


def test_nothing_is_written_and_warnings_still_count(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    with mujoco_silenced:
        assert step_into_trouble() == 1
    assert capfd.readouterr() == ("", "")
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def heard():
    """What MuJoCo warns of, by a handler that stands as long as the test."""
    messages = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(messages.append)
    yield messages
    mujoco.set_mju_user_warning(before)


def test_the_last_to_leave_puts_back_the_handler(heard):
    with mujoco_silenced:
        with mujoco_silenced:
            step_into_trouble()
        step_into_trouble()
    assert heard == []
    step_into_trouble()
    assert len(heard) == 1


def test_a_handler_set_while_another_simulation_steps_neither_hears_nor_is_lost(heard):
    with mujoco_silenced:  # the other simulation: a thread of emulated motors, say
        mujoco.set_mju_user_warning(heard.append)
        with mujoco_silenced:
            step_into_trouble()
        assert heard == []
    step_into_trouble()
    assert len(heard) == 1
