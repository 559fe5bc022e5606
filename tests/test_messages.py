"""Events are numbered as in recordings; `tests/survive` has modes, intents and safety bits."""

from humanoid_sim.messages import EventKind


def test_numbers_of_events():
    names = "NOTE FRESH_START SUPPORT FAILURE LOSS ENDING FALL PUSH"
    assert [(kind.name, kind.value) for kind in EventKind] == [(name, i) for i, name in enumerate(names.split())]
