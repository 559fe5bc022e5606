import pytest

from humanoid_sim.hardware.robstride.firmware import gain_factor, has_active_reports, parse_version, position_range
from humanoid_sim.robots.motors import MOTORS, POSITION_RANGE


@pytest.mark.parametrize(
    ("model", "version", "range_", "factor", "reports"),
    [
        ("rs-00", "0.0.2.6", 12.5, 1.0, False),
        ("rs-00", "0.0.2.7", POSITION_RANGE, 1.0, False),
        ("rs-01", "0.1.2.1", 12.5, 1.4167, False),
        ("rs-01", "0.1.3.3", POSITION_RANGE, 1.4167, True),
        ("rs-01", "0.1.3.4", POSITION_RANGE, 1.0, True),
        ("rs-02", "0.2.2.11", 12.5, 1.4167, False),
        ("rs-02", "0.2.3.6", POSITION_RANGE, 1.0, True),
        ("rs-03", "0.3.0.5", 12.5, 1.0, False),
        ("rs-05", "0.5.0.0", POSITION_RANGE, 1.0, True),
    ],
)
def test_ranges_and_gains_depend_on_the_version(model, version, range_, factor, reports):
    found = parse_version(version)
    assert (position_range(MOTORS[model], found), gain_factor(MOTORS[model], found)) == (range_, factor)
    assert has_active_reports(MOTORS[model], found) == reports
