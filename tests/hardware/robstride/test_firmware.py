import pytest

from humanoid_sim.hardware.robstride.firmware import firmware_problem, has_active_reports, is_documented
from humanoid_sim.robots.motors import MOTORS


@pytest.mark.parametrize(
    ("model", "version", "problem", "documented", "reports"),
    [
        ("rs-00", "0.0.2.6", "12.5 rad", True, False),
        ("rs-00", "0.0.2.7", "", True, False),
        ("rs-01", "0.1.3.3", "1.4167", True, True),
        ("rs-01", "0.1.3.4", "", True, True),
        ("rs-02", "0.2.2.11", "older than 0.2.3.6", True, False),
        ("rs-02", "0.2.3.6", "", True, True),
        ("rs-02", "0.2.3.10", "", False, True),
        ("rs-03", "0.3.0.5", "12.5 rad", True, False),
        ("rs-04", "0.0.3.0", "is of rs-00", True, False),
        ("rs-05", "0.5.0.0", "", False, True),
    ],
)
def test_firmware_decides_whether_and_how_a_motor_is_driven(model, version, problem, documented, reports):
    found = tuple(int(number) for number in version.split("."))
    text = firmware_problem(MOTORS[model], found)
    assert problem in text
    assert bool(problem) == bool(text)
    assert is_documented(MOTORS[model], found) == documented
    assert has_active_reports(MOTORS[model], found) == reports
