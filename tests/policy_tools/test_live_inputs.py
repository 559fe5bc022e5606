"""A contract with a live input is checked, shown and stamped without samples."""

import pytest
from trainer import contract, save_checkpoint, terms

from humanoid_sim.controllers.contract import Term
from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.onnx_policy import read_header
from humanoid_sim.policy.readers.own import GOLDEN_KEY


@pytest.fixture
def live(tmp_path):
    """Writes the trainer's policy with two values of a sensor of its own in the place of a clock's."""

    def write(**options):
        mood = Term("foot_contact", width=2, **options)
        observed = [mood if term.name == "sin_phase" else term for term in terms()]
        return save_checkpoint(tmp_path / "live.onnx", contract(observation=observed))

    return write


def test_it_is_checked_shown_and_stamped_without_samples(cli, live, robot, tmp_path):
    path = live(topic="/feet", timeout=float("inf"))
    status, _, error = cli("check", path, "--robot", robot.mjcf_path)
    assert status == 0, error
    assert "topic /feet, timeout inf of foot_contact" in cli("show", path)[1]
    output = tmp_path / "stamped.onnx"
    assert "golden vectors: none" in cli("stamp", path, "-o", output)[1]
    assert GOLDEN_KEY not in read_header(output)[0]
    assert dict(load_checkpoint(output).contract.live_inputs) == {"foot_contact": 2}


def test_a_topic_of_the_sessions_own_is_refused(live):
    with pytest.raises(InputError, match="live input 'foot_contact': its topic is /tf, which a session uses itself"):
        load_checkpoint(live(topic="/tf")).with_motion()
