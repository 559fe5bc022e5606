import mujoco
import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.model import build_model
from humanoid_sim.simulation.stance import Floor
from humanoid_sim.simulation.terrain import Terrain

BIPED = load_robot("lite_biped")
SMALL = {"levels": 2, "variants": 2, "tile": 4.0}


@pytest.mark.parametrize("kind", ["rough", "slopes", "steps", "mixed"])
def test_a_field_is_level_at_its_edges_and_on_its_platforms(kind):
    terrain = Terrain(kind, levels=3, variants=5, tile=4.0)
    heights = terrain.heights()
    assert heights.shape == (5 * 40 + 1, 3 * 40 + 1)
    np.testing.assert_array_equal(heights[::40], 0.0)
    np.testing.assert_array_equal(heights[:, ::40], 0.0)
    for level in range(3):
        for variant in range(5):
            middle = heights[variant * 40 + 15 : variant * 40 + 26, level * 40 + 15 : level * 40 + 26]
            np.testing.assert_array_equal(middle, middle[0, 0])
    hardness = [np.abs(heights[:, i * 40 : i * 40 + 41]).max() for i in range(3)]
    assert 0.0 < hardness[0] < hardness[1] < hardness[2]


def test_slopes_and_steps_are_as_steep_and_high_as_they_say_up_and_down():
    slopes = Terrain("slopes", slope=0.2, **SMALL).heights()
    gradient = np.diff(slopes, axis=1) / 0.1
    assert gradient.max() == pytest.approx(np.tan(0.2))
    assert gradient.min() == pytest.approx(-np.tan(0.2))
    assert slopes[20, 60] == pytest.approx(-np.tan(0.2) * 1.4)
    assert slopes[60, 60] == pytest.approx(np.tan(0.2) * 1.4)
    assert slopes[20, 20] == pytest.approx(np.tan(0.1) * 1.4, rel=0.01)
    steps = Terrain("steps", step_height=0.12, step_depth=0.5, **SMALL).heights()
    assert np.unique(steps[:, 41:].round(9)).tolist() == [-0.24, -0.12, 0.0, 0.12, 0.24]


def test_bumps_are_of_the_seed():
    first, second = (Terrain("rough", seed=seed, **SMALL).heights() for seed in (0, 1))
    np.testing.assert_array_equal(first, Terrain("rough", seed=0, **SMALL).heights())
    assert np.abs(first - second).max() > 0.02
    assert 0.06 < np.ptp(first) <= 0.08


def test_an_episode_begins_on_a_platform_as_hard_as_is_allowed():
    terrain = Terrain("steps", levels=4, variants=3)
    numbers = np.random.default_rng(0).random((300, 2))
    everywhere, easy = terrain.spawn(numbers), terrain.spawn(numbers, hardness=0.0)
    assert sorted(set(everywhere[:, 0])) == [-9.0, -3.0, 3.0, 9.0]
    assert sorted(set(everywhere[:, 1])) == [-6.0, 0.0, 6.0]
    assert set(easy[:, 0]) == {-9.0}
    assert set(terrain.spawn(numbers, hardness=0.5)[:, 0]) == {-9.0, -3.0, 3.0}
    field = terrain.heights()
    for x, y, z in everywhere:
        assert field[round((y + 9.0) / 0.1), round((x + 12.0) / 0.1)] == z
    np.testing.assert_array_equal(terrain.spawn(numbers[7]), everywhere[7])


@pytest.mark.parametrize("kind", ["rough", "steps"])
def test_the_floor_is_where_a_ray_hits_it(kind):
    model = build_model(BIPED, scene="floor", terrain=Terrain(kind, **SMALL))
    floor = Floor(model)
    points = np.random.default_rng(1).uniform(-6.0, 6.0, (400, 3))
    points[:, 2] = 3.0
    levels = floor.level(points)
    data = mujoco.MjData(model)
    data.qpos[2] = 100.0
    mujoco.mj_kinematics(model, data)
    group = np.array([1, 1, 1, 1, 1, 1], dtype=np.uint8)
    for point, level in zip(points, levels, strict=True):
        distance = mujoco.mj_ray(model, data, point, np.array([0.0, 0.0, -1.0]), group, True, -1, None)
        assert 3.0 - distance == pytest.approx(level, abs=1e-6)
    assert (levels[(np.abs(points[:, :2]) > 4.0).any(axis=1)] == 0.0).all()
    assert np.abs(levels).max() > 0.02
    assert floor.level(points[0]).shape == ()
    assert floor.level(points[0]) == levels[0]


def test_what_stands_on_the_field_is_a_floor_too_and_a_ground_of_the_robots_own_is_the_only_one(small_robot):
    def with_box(spec):
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 0.1, 0.1], pos=[1.0, 0.0, 0.5])

    model = build_model(BIPED, scene="floor", terrain=Terrain("rough", **SMALL), edit=with_box)
    assert float(Floor(model).level(np.array([1.0, 0.0, 3.0]))) == pytest.approx(0.6)
    mjcf = """<mujoco><worldbody><geom type="plane" size="1 1 1"/><body name="trunk"><freejoint/><geom size="0.1"/>
      <body><joint name="hinge"/><geom size="0.1"/></body></body></worldbody></mujoco>"""
    robot = small_robot(mjcf, ("hinge",), imu="trunk", base={"type": "floating", "body": "trunk"})
    with pytest.raises(InputError, match=r"terrain: .* brings a ground of its own"):
        build_model(robot, scene="floor", terrain=Terrain("rough"))


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("stairs", r"terrain: unknown kind 'stairs'; known: flat, rough, slopes, steps, mixed"),
        (3, "terrain: is 3, expected flat, rough, slopes, steps, mixed, or the fields of a Terrain with its kind"),
        ({"levels": 2}, r"terrain: is \{'levels': 2\}, expected flat, rough"),
        ({"kind": "rough", "size": 2}, "terrain: unknown field 'size'; known: kind, seed"),
        ({"kind": "rough", "levels": 0}, "terrain: levels is 0, expected a whole number >= 1"),
        ({"kind": "rough", "tile": float("nan")}, "terrain: tile is nan, expected a finite number > 0"),
        ({"kind": "slopes", "slope": 1.0}, "terrain: slope is 1, expected at most 0.8 rad"),
        ({"kind": "rough", "platform": 6.0}, "terrain: platform is 6 m, expected less than the tile of 6 m"),
        ({"kind": "rough", "resolution": 0.001}, "terrain: has 576000000 points, expected <= 4000000"),
    ],
)
def test_what_there_is_not_is_refused(value, message):
    with pytest.raises(InputError, match=message):
        Terrain.of(value)


def test_a_terrain_by_its_name_or_fields():
    assert Terrain.of(None) is Terrain.of("flat") is None
    assert Terrain.of("steps") == Terrain("steps")
    assert Terrain.of({"kind": "steps", "levels": 2}) == Terrain("steps", levels=2)
