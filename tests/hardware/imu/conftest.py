import pytest
from emulated_imu import EmulatedImu


@pytest.fixture
def device():
    """An emulated device behind a pseudo terminal."""
    emulated = EmulatedImu()
    yield emulated
    emulated.close()
