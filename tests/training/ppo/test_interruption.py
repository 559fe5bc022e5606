import signal

import pytest

from humanoid_sim.training.ppo.run import interruptible


@pytest.fixture(autouse=True)
def usual_handler():
    """Whatever the test runner has inherited."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_the_first_is_noted_and_the_second_ends(capfd):
    with interruptible() as interruption:
        assert not interruption.is_set()
        signal.raise_signal(signal.SIGINT)
        assert interruption.is_set()
        assert "Ctrl-C: ends after this update, with a checkpoint; once more ends at once\n" in capfd.readouterr().err
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_the_handler_is_as_it_was_afterwards():
    with interruptible() as interruption:
        assert signal.getsignal(signal.SIGINT) is not signal.default_int_handler
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert not interruption.is_set()


def test_a_process_that_ignores_it_goes_on_to():
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with interruptible() as interruption:
        signal.raise_signal(signal.SIGINT)
    assert not interruption.is_set()
    assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
