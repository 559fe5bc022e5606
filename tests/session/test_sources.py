import re

import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.session.sources import parse_velocity

RANGES = np.array([[-0.5, 1.0], [-0.5, 0.5], [-1.0, 1.0]])


@pytest.mark.parametrize(
    ("text", "ranges", "problem"),
    [
        *((text, None, f"is '{text}', expected vx,vy,wz") for text in ("", "1,2", "1,2,3,4", "a,b,c", "nan,0,0")),
        ("1.1,0,0", RANGES, "vx is "),
        ("0,-0.6,0", RANGES, "vy is "),
        ("0,0,30", RANGES, "wz is 30 rad/s, expected -1 to 1 rad/s"),
        ("0,0,30", None, "wz is 30 rad/s, expected -12.57 to 12.57 rad/s"),
        ("50,0,0", None, "vx is 50 m/s, expected -10 to 10 m/s"),
    ],
)
def test_anything_else_or_beyond_what_is_known_is_refused_and_its_unit_questioned(text, ranges, problem):
    with pytest.raises(InputError, match=f"^--command: {re.escape(problem)}"):
        parse_velocity(text, ranges)
