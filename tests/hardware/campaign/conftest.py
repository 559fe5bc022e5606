import pytest

_HEADINGS = ("fault", "mode", "flag", "detected ms", "reaction ms", "torque beyond damping N·m", "slow motion")


@pytest.fixture
def table(table_of):
    """Rows of the campaign's table: fault, mode, flag, detection time, reaction time, torque."""
    return table_of("faults on emulated motors", _HEADINGS)
