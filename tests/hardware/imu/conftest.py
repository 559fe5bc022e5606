import sys
from pathlib import Path

import pytest

# importlib mode leaves sys.path alone.
sys.path.append(str(Path(__file__).parent))

from emulated_imu import EmulatedImu


@pytest.fixture
def device():
    """An emulated device behind a pseudo terminal."""
    emulated = EmulatedImu()
    yield emulated
    emulated.close()
