"""Suites: the shipped ones, and one clear line for whatever is wrong with another."""

import pytest
from regress_runs import SHORT, yaml_suite

from humanoid_sim.errors import InputError
from humanoid_sim.regress.metrics import ALWAYS
from humanoid_sim.regress.suite import load_suite


@pytest.mark.parametrize("name", ["lite_tracking", "velocity", "lite_piano"])
def test_shipped_suites(name):
    suite, _ = load_suite(name)
    assert suite.name == name
    assert suite.seeds >= 8
    assert set(ALWAYS[suite.task]) <= set(suite.tolerances)


def test_a_suite_of_ones_own(tmp_path):
    suite, folder = load_suite(str(yaml_suite(tmp_path)))
    assert folder == tmp_path.resolve()
    assert [case.name for case in suite.cases] == ["wave", "drum"]
    assert suite.seed_numbers == (0, 1, 2)
    assert [metric.name for metric in suite.metrics] == ["body_position_error", "joint_error", "losses", "faults"]
    assert suite.disturbance.randomisation.mass == (0.9, 1.1)
    assert suite.tolerance("joint_error", -2.0) == pytest.approx(0.1)
    assert suite.tolerance("losses", 0.5) == 0.01


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("", "- 1\n", "is not a suite, expected a mapping"),
        ("", "name: x\n", "misses required field 'task'"),
        ("task: tracking", "task: drums", "task: is 'drums', expected one of tracking, velocity, piano"),
        ("mass: [0.9, 1.1]", "mass: [0, 1]", "randomisation: mass is (0.0, 1.0), expected more than 0"),
        (
            "command_delay: [0.0, 0.004]",
            "command_delay: [0, 1e9]",
            "randomisation: command_delay is (0.0, 1000000000.0)",
        ),
        ("seeds: 3\n", "seeds: three\n", "seeds: is 'three', expected a whole number"),
        ("seeds: 3\n", "seeds: 1\n", "seeds: is 1, expected at least 2"),
        ("seeds: 3\n", "seeds: 3\nseedz: 4\n", "unknown field 'seedz' (did you mean 'seeds'?)"),
        ("name: drum", "name: wave", "cases[1].name: 'wave' is given twice"),
        ("duration: 0.4", "duration: -1", "cases[0].duration: is -1, expected more than 0"),
        ("motion: wave", "command: [1, 0, 0]", "cases[0].command: is of no use to a tracking task"),
        ("task: tracking", "task: velocity", "cases[0].motion: is of no use to a velocity task"),
        ("task: tracking", "task: piano", "cases[0].motion: is of no use to a piano task, expected a song"),
        ("motion: wave", "song: twinkle", "cases[0].song: is of no use to a tracking task, expected a motion"),
        ("joint_error:", "elbow_error:", "tolerances: unknown tracking metric 'elbow_error'; known: body_pos"),
        ("{relative: 0.05}", "{relative: -1}", "tolerances.body_position_error.relative: is -1.0, expected"),
        ("mass: [0.9, 1.1]", "mass: [1.1, 0.9]", "randomisation: mass is (1.1, 0.9), expected two finite"),
        ("mass: [0.9, 1.1]", "weight: [1, 1]", "randomisation: unknown field 'weight'; known: mass, "),
        ("joint_position: 0.05", "joint_position: .nan", "start.joint_position: is nan, expected a number"),
        ("command_delay: [0.0, 0.004]", "command_jitter: 2", "randomisation: command_jitter is 2, expected at"),
        ("", "seeds: [1\n", "not valid YAML"),
        ("", "seeds: 1\nseeds: 2\n", "'seeds' is given twice"),
    ],
)
def test_a_bad_suite_is_one_line(tmp_path, before, after, message):
    """The short suite with something in another's place; with nothing before: this and nothing else."""
    assert before in SHORT
    path = yaml_suite(tmp_path, SHORT.replace(before, after) if before else after)
    with pytest.raises(InputError) as error:
        load_suite(str(path))
    assert str(error.value).startswith(f"{path}: ")
    assert message in str(error.value)
    assert "\n" not in str(error.value)
