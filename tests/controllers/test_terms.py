"""Height scans as terms write them down: their grid, and what is refused."""

import numpy as np
import pytest
from rig import JOINTS, contract, state

from humanoid_sim.controllers.policy_step import PolicyWiring
from humanoid_sim.controllers.reference import no_reference
from humanoid_sim.controllers.terms import HeightScan, Term
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import Extern

TWO = Term("height_scan", grid=(0.1, 0.0), scale=2.0, clip=(-1.0, 1.0))


def wired(*terms, rays=2):
    made = contract(task_type="locomotion", body_names=(), observation=(*terms, Term("joint_pos")))
    return PolicyWiring(JOINTS, made, no_reference(), {"height_scan": rays})


def test_the_defaults_are_mjlabs():
    scan = Term("height_scan").height_scan
    assert (scan, scan.count, scan.missed) == (HeightScan(), 187, 5.0)
    assert scan.points[[0, 1, 16, 17, 186]] == pytest.approx(
        np.array([[-0.8, -0.5], [-0.7, -0.5], [0.8, -0.5], [-0.8, -0.4], [0.8, 0.5]])
    )


@pytest.mark.parametrize(
    ("grid", "resolution", "x", "y"),
    [
        ((0.4, 0.2), 0.2, [-0.2, 0.0, 0.2], [-0.1, 0.1]),
        ((0.5, 0.0), 0.2, [-0.25, -0.05, 0.15], [0.0]),  # Isaac Lab's points too lie within the grid
        ((0.3, 0.7), 0.1, [-0.15, -0.05, 0.05, 0.15], np.arange(8) * 0.1 - 0.35),  # 0.7 / 0.1 is below 7
        ((0.0, 0.0), 0.1, [0.0], [0.0]),
    ],
)
def test_points_of_a_grid(grid, resolution, x, y):
    first_x = HeightScan(grid=grid, resolution=resolution)
    first_y = HeightScan(grid=grid, resolution=resolution, ray_order="yx")
    assert first_x.points == pytest.approx(np.array([(each, other) for other in y for each in x]))
    assert first_y.points == pytest.approx(np.array([(each, other) for each in x for other in y]))
    assert first_x.count == first_y.count == len(x) * len(y)


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"grid": (1.6,)}, r"grid is \[1.6\], expected two lengths, along x and y"),
        ({"grid": (1.0, -0.1)}, "grid is -0.1, expected a finite number >= 0"),
        ({"resolution": 0.0}, "resolution is 0.0, expected a finite number > 0"),
        ({"resolution": 0.01}, "resolution is 0.01, 16261 rays, expected <= 2000"),
        ({"range": float("inf")}, "range is inf, expected a finite number > 0"),
        ({"above": -1.0}, "above is -1.0, expected a finite number >= 0"),
        ({"miss": float("nan")}, "miss is nan, expected a finite number"),
        ({"ray_order": "zx"}, "ray_order is 'zx', expected xy or yx"),
    ],
)
def test_a_grid_that_cannot_be_is_refused(options, problem):
    with pytest.raises(FieldError, match=f"^observation term 'scan': {problem}"):
        Term("scan", kind="height_scan", **options)
    with pytest.raises(FieldError, match=r"'joint_pos': offset is 0.5, expected none: only a height_scan has one$"):
        Term("joint_pos", offset=0.5)


def test_a_policy_has_one_scan_of_the_robots_width():
    again = Term("again", kind="height_scan", grid=(0.1, 0.0), history=3)
    assert wired(TWO, again).layout.width == 2 + 6 + 3
    other = Term("other", kind="height_scan", grid=(0.1, 0.0), offset=0.5)
    with pytest.raises(FieldError, match=r"terms 'height_scan' and 'other' have different height scans, expected one$"):
        wired(TWO, other)
    with pytest.raises(FieldError, match=r"'height_scan': has 2 rays, but the robot's scan has 187$"):
        wired(TWO, rays=187)
    made = contract(task_type="locomotion", body_names=(), observation=(TWO,))
    with pytest.raises(FieldError, match="needs a height scan: a simulation makes it, on a robot a program has to"):
        PolicyWiring(JOINTS, made, no_reference(), {})


def test_values_are_clipped_and_scaled_and_stop_the_policy_when_they_are_missing_or_too_old():
    wiring = wired(TWO)
    values = {"height_scan": Extern([0.3, 5.0], 1.0, timeout=0.5)}

    def observed(now, extern):
        given = state(now, extern=extern)
        observation, _ = wiring.observe(wiring.activate(given), given)
        return observation[:2].tolist(), wiring.observation_problem(observation)

    assert observed(1.5, values) == (pytest.approx([0.6, 2.0]), "")
    for now, extern in ((1.502, values), (1.0, {})):
        seen, problem = observed(now, extern)
        assert np.isnan(seen).all()
        assert problem == (
            "observation height_scan[0] is nan, expected a finite number: "
            "no height scan has come, or the last one is too old"
        )
