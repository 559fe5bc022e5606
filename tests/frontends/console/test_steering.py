import numpy as np
import pytest

from humanoid_sim.errors import FieldError
from humanoid_sim.frontends.console.turn import Due, Steering
from humanoid_sim.messages import Mode

RANGES = np.array([[-0.5, 1.0], [-0.3, 0.3], [-1.0, 1.0]])
NOBODY = np.zeros(3)
WALKS = Mode.LOCOMOTION


def ms(value):
    return int(1e6 * value)


def test_keys_step_from_the_present_command_within_the_ranges():
    steering = Steering(RANGES)
    steering.press(1, "w", np.array([0.25, 0.0, 0.0]), WALKS, ms(0))
    assert steering.velocity.tolist() == [0.35, 0.0, 0.0]
    for _ in range(9):
        steering.press(1, "up", NOBODY, WALKS, ms(1))
    assert steering.velocity.tolist() == [1.0, 0.0, 0.0]
    steering.press(1, "right", NOBODY, WALKS, ms(2))
    assert steering.velocity.tolist() == [1.0, 0.0, -0.1]


def test_a_slider_changes_one_component():
    steering = Steering(RANGES)
    steering.steer(1, 2, 9.0, np.array([0.25, 0.1, 0.0]), WALKS, ms(0))
    assert steering.due(ms(1)) == Due((0.25, 0.1, 1.0), True, ms(0))


def test_a_change_is_deliberate_for_a_while_and_as_old_as_the_page_was_heard():
    steering = Steering(RANGES)
    steering.steer(1, 0, 0.5, NOBODY, WALKS, ms(0))
    steering.beat(1, ms(80), ms(20))
    steering.beat(2, ms(90), ms(90))  # another page's heart
    assert steering.due(ms(100)) == Due((0.5, 0.0, 0.0), True, ms(80))
    assert steering.due(ms(101)) == Due((0.5, 0.0, 0.0), False, ms(80))


def test_it_ends_when_the_page_is_not_heard():
    steering = Steering(RANGES)
    steering.steer(1, 0, 0.5, NOBODY, WALKS, ms(0))
    assert steering.problem(WALKS, None, ms(250)) == ""
    assert steering.problem(WALKS, None, ms(251)) == "page 1 was not heard for 0.25 s"
    steering.beat(1, ms(1100), ms(100))
    assert steering.problem(WALKS, None, ms(1100)) == ""
    steering.beat(1, ms(1150), ms(100))  # its thread that draws has stood still since
    assert steering.problem(WALKS, None, ms(1150)) == "page 1 shows what is older than 1 s"


def test_it_ends_with_the_mode_and_with_another_owner():
    steering = Steering(RANGES)
    steering.steer(1, 0, 0.5, NOBODY, WALKS, ms(0))
    assert steering.problem(Mode.DAMPING, None, ms(1)) == "mode is DAMPING"
    assert steering.problem(WALKS, "gamepad (7)", ms(1)) == "gamepad (7) controls it now"
    assert steering.problem(WALKS, "", ms(1)) == "no longer controlled by anyone"


def test_a_stop_is_sent_while_it_is_news_and_then_left_alone():
    steering = Steering(RANGES)
    steering.steer(1, 0, 0.5, NOBODY, WALKS, ms(0))
    steering.press(1, "0", NOBODY, WALKS, ms(500))
    assert steering.due(ms(600)) == Due((0.0, 0.0, 0.0), True, ms(500))
    assert steering.due(ms(601)) is None
    assert steering.page is None


def test_a_stop_is_taken_in_every_mode_and_a_velocity_in_locomotion():
    steering = Steering(RANGES)
    with pytest.raises(FieldError, match="velocity refused: requires LOCOMOTION, mode is STANDBY"):
        steering.press(1, "w", NOBODY, Mode.STANDBY, ms(0))
    assert steering.page is None
    steering.press(1, "0", np.array([0.5, 0.0, 0.0]), Mode.STANDBY, ms(0))
    assert steering.due(ms(1)) == Due((0.0, 0.0, 0.0), True, ms(0))


def test_the_page_that_changed_it_last_steers():
    steering = Steering(RANGES)
    steering.steer(1, 0, 0.5, NOBODY, WALKS, ms(0))
    steering.steer(2, 1, 0.2, np.array([0.5, 0.0, 0.0]), WALKS, ms(10))
    assert (steering.page, steering.velocity.tolist()) == (2, [0.5, 0.2, 0.0])


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_hostile_values_are_refused(value):
    with pytest.raises(FieldError, match="expected a finite number"):
        Steering(RANGES).steer(1, 0, value, NOBODY, WALKS, ms(0))
    with pytest.raises(FieldError, match="axis is -1, expected 0, 1 or 2"):
        Steering(RANGES).steer(1, -1, 0.1, NOBODY, WALKS, ms(0))
    with pytest.raises(FieldError, match="unknown key 'x'"):
        Steering(RANGES).press(1, "x", NOBODY, WALKS, ms(0))
