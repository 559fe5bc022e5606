"""A contract with a live input is checked, shown and stamped without samples."""

import pytest
from trainer import contract, save_checkpoint, terms

from humanoid_sim.controllers.contract import Term
from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import load_checkpoint


@pytest.fixture
def live(tmp_path):
    """Writes the trainer's policy with two values of a sensor of its own in the place of a clock's."""

    def write(**options):
        mood = Term("foot_contact", width=2, **options)
        observed = [mood if term.name == "sin_phase" else term for term in terms()]
        return save_checkpoint(tmp_path / "live.onnx", contract(observation=observed))

    return write


def test_a_topic_of_the_sessions_own_is_refused(live):
    with pytest.raises(InputError, match="live input 'foot_contact': its topic is /tf, which a session uses itself"):
        load_checkpoint(live(topic="/tf")).with_motion()
