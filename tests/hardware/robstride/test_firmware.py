import pytest

from humanoid_sim.hardware.robstride.firmware import firmware_of, parse_version
from humanoid_sim.robots.motors import MOTORS, POSITION_RANGE


@pytest.mark.parametrize(
    ("model", "version", "position_range", "gain_factor", "has_reports", "as_status"),
    [
        ("rs-00", "0.0.2.6", 12.5, 1.0, False, True),
        ("rs-00", "0.0.2.7", POSITION_RANGE, 1.0, False, True),
        ("rs-00", "0.0.3.0", POSITION_RANGE, 1.0, True, True),
        ("rs-00", "0.0.3.3", POSITION_RANGE, 1.0, True, False),
        ("rs-01", "0.1.2.1", 12.5, 1.4167, False, True),
        ("rs-01", "0.1.3.3", POSITION_RANGE, 1.4167, True, False),
        ("rs-01", "0.1.3.4", POSITION_RANGE, 1.0, True, False),
        ("rs-02", "0.2.2.11", 12.5, 1.4167, False, False),
        ("rs-02", "0.2.3.5", POSITION_RANGE, 1.4167, True, False),
        ("rs-02", "0.2.3.6", POSITION_RANGE, 1.0, True, False),
        ("rs-03", "0.3.0.5", 12.5, 1.0, False, True),
        ("rs-04", "0.4.1.2", POSITION_RANGE, 1.0, True, True),
        ("rs-05", "0.5.0.0", POSITION_RANGE, 1.0, True, False),
        ("rs-06", "0.0.0.0", POSITION_RANGE, 1.0, True, False),
    ],
)
def test_what_a_version_means(model, version, position_range, gain_factor, has_reports, as_status):
    firmware = firmware_of(MOTORS[model], parse_version(version))
    assert (firmware.position_range, firmware.gain_factor) == (position_range, gain_factor)
    assert (firmware.has_active_reports, firmware.reports_as_status) == (has_reports, as_status)
    assert firmware.applied_to(MOTORS[model]).position == position_range
