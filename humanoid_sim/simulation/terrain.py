"""Ground to walk on that is not flat: rough, slopes and steps, as a height field of tiles that grow harder."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any, Literal, get_args

import mujoco
import numpy as np

from humanoid_sim.errors import InputError, known_names, require_known
from humanoid_sim.mit import FloatArray

TerrainKind = Literal["rough", "slopes", "steps", "mixed"]

_NAME = "humanoid_sim_terrain"
_BASE = 0.5
"""m of solid ground below the lowest point."""
_WIDE = 50.0
"""m of flat ground around the field."""
_MOST_CELLS = 4_000_000
_PARTS: Mapping[str, tuple[str, ...]] = {"mixed": ("rough", "slopes", "steps")}


@dataclass(frozen=True, slots=True)
class Terrain:
    """A field of square tiles around the origin, each with a flat platform in its middle, where an episode may begin.

    Along x the tiles grow harder, from a share 1 / `levels` of the figures below to all of it; along y they differ by
    chance. Slopes and steps lead from the platform up on one tile and down on the next. At the edges of the tiles, and
    around the field, the ground is as high as the robot's floor.
    """

    kind: TerrainKind
    """`rough`: bumps; `slopes` and `steps`: pyramids and pits; `mixed`: the three in turn."""
    seed: int = 0
    """Seed of the bumps."""
    levels: int = 4
    """Tiles along x."""
    variants: int = 4
    """Tiles along y."""
    tile: float = 6.0
    """m, side of a tile."""
    platform: float = 1.2
    """m, side of the flat ground in its middle."""
    resolution: float = 0.1
    """m between two points of the field: the edge of a step is a ramp of this length."""
    bump_height: float = 0.08
    """m from the lowest to the highest point of the hardest bumps."""
    slope: float = 0.3
    """rad, of the hardest slope."""
    step_height: float = 0.1
    """m, of the hardest steps."""
    step_depth: float = 0.4
    """m from one step to the next."""

    def __post_init__(self) -> None:
        """Check every field. Raises `InputError` naming the field, its value and what is accepted."""
        kinds = get_args(TerrainKind)
        if self.kind not in kinds:
            raise InputError(f"terrain: {known_names('kind', str(self.kind), ('flat', *kinds))}")
        for name, least in (("seed", 0), ("levels", 1), ("variants", 1)):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < least:
                raise InputError(f"terrain: {name} is {value!r}, expected a whole number >= {least}")
        for name in ("tile", "platform", "resolution", "bump_height", "slope", "step_height", "step_depth"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < math.inf:
                raise InputError(f"terrain: {name} is {value!r}, expected a finite number > 0")
        if self.slope > 0.8:
            raise InputError(f"terrain: slope is {self.slope:g}, expected at most 0.8 rad")
        if self.platform + 4.0 * self.resolution > self.tile:
            raise InputError(
                f"terrain: platform is {self.platform:g} m, expected less than the tile of {self.tile:g} m by four "
                f"times the resolution of {self.resolution:g} m"
            )
        cells = self.levels * self.variants * (self.tile / self.resolution) ** 2
        if cells > _MOST_CELLS:
            raise InputError(
                f"terrain: has {cells:.0f} points, expected <= {_MOST_CELLS}: fewer tiles, or coarser ones"
            )

    @classmethod
    def of(cls, value: Terrain | Mapping[str, Any] | str | None) -> Terrain | None:
        """Return the terrain itself, one with these fields, or of that kind; None for flat ground.

        Raises `InputError` where there is no such kind or field, or it is not what it should be.
        """
        if value is None or value == "flat" or isinstance(value, Terrain):
            return value if isinstance(value, Terrain) else None
        if isinstance(value, str):
            return cls(value)  # type: ignore[arg-type]  # checked at construction
        known = [field.name for field in fields(cls)]
        if not isinstance(value, Mapping) or "kind" not in value:
            kinds = ", ".join(("flat", *get_args(TerrainKind)))
            raise InputError(f"terrain: is {value!r}, expected {kinds}, or the fields of a Terrain with its kind")
        require_known("field", value, known, "terrain: ")
        return cls(**value)

    def heights(self) -> FloatArray:
        """Shape (rows along y, columns along x), m above the robot's floor; `resolution` apart, around the origin."""
        return _heights(self)

    @property
    def _cells(self) -> int:
        """Return the number of cells along a tile's side."""
        return max(round(self.tile / self.resolution), 1)

    def _tile(self, level: int, variant: int) -> FloatArray:
        """Heights of one tile, shape (c + 1, c + 1), m; 0 at its edges."""
        parts = _PARTS.get(self.kind, (self.kind,))
        # Neighbours differ along both axes: up and down, and each kind both ways.
        part, share = parts[variant % len(parts)], (level + 1) / self.levels
        rises = (level + variant // len(parts)) % 2 == 0
        line = (np.arange(self._cells + 1) / self._cells - 0.5) * self.tile
        away = np.maximum(np.abs(line)[:, None], np.abs(line)[None, :])  # m from the tile's middle, in squares
        inward = np.clip(0.5 * self.tile - away, 0.0, 0.5 * (self.tile - self.platform))
        sign = 1.0 if rises else -1.0
        if part == "slopes":
            return sign * math.tan(share * self.slope) * inward
        if part == "steps":
            whole = 0.5 * (self.tile - self.platform) // self.step_depth
            risen: FloatArray = np.minimum(np.floor(inward / self.step_depth + 1e-9), whole)
            return sign * share * self.step_height * risen
        random = np.random.default_rng([self.seed, level, variant])
        bumps = random.uniform(-0.5, 0.5, away.shape) * share * self.bump_height
        beside = away - 0.5 * self.platform
        fade = np.clip(np.minimum(inward, np.maximum(beside, 0.0)) / (4.0 * self.resolution), 0.0, 1.0)
        return bumps * fade

    @property
    def draws(self) -> int:
        """Random numbers that a start takes."""
        return 2

    def spawn(self, numbers: FloatArray) -> FloatArray:
        """Middles of platforms, shape (..., 3), m, world frame, from the robot's floor at the origin.

        `numbers`, shape (..., 2), are uniform in [0, 1).
        """
        level = np.floor(numbers[..., 0] * self.levels).astype(np.intp)
        variant = np.floor(numbers[..., 1] * self.variants).astype(np.intp)
        middle = self._cells // 2
        high = self.heights()[variant * self._cells + middle, level * self._cells + middle]
        x = (level + 0.5 - 0.5 * self.levels) * self._span
        y = (variant + 0.5 - 0.5 * self.variants) * self._span
        return np.stack([x, y, high], axis=-1)

    @property
    def _span(self) -> float:
        """m, side of a tile in whole cells."""
        return self._cells * self.resolution


@lru_cache(maxsize=8)
def _heights(terrain: Terrain) -> FloatArray:
    side = terrain._cells
    field = np.zeros((terrain.variants * side + 1, terrain.levels * side + 1))
    for level in range(terrain.levels):
        for variant in range(terrain.variants):
            rows, columns = (slice(i * side, (i + 1) * side + 1) for i in (variant, level))
            field[rows, columns] = terrain._tile(level, variant)
    field.setflags(write=False)
    return field


def add_terrain(spec: mujoco.MjSpec, terrain: Terrain, **of_a_floor: Any) -> None:
    """Add the field, and flat ground around it; the rest are attributes of a floor's geom."""
    heights = terrain.heights()
    lowest, highest = float(heights.min()), float(heights.max())
    spread = max(highest - lowest, 1e-6)
    half_x, half_y = (0.5 * (n - 1) * terrain.resolution for n in (heights.shape[1], heights.shape[0]))
    spec.add_hfield(
        name=_NAME,
        nrow=heights.shape[0],
        ncol=heights.shape[1],
        size=[half_x, half_y, spread, _BASE],
        userdata=((heights - lowest) / spread).ravel().tolist(),
    )
    x, y, z = of_a_floor.pop("pos")
    name = of_a_floor.pop("name")
    spec.worldbody.add_geom(
        name=name, type=mujoco.mjtGeom.mjGEOM_HFIELD, hfieldname=_NAME, pos=[x, y, z + lowest], **of_a_floor
    )
    thick, long = 0.5 * _BASE, 0.5 * _WIDE
    for dx, dy, half_width, half_depth in (
        (half_x + long, 0.0, long, half_y + _WIDE),
        (-half_x - long, 0.0, long, half_y + _WIDE),
        (0.0, half_y + long, half_x, long),
        (0.0, -half_y - long, half_x, long),
    ):
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[half_width, half_depth, thick],
            pos=[x + dx, y + dy, z - thick],
            **of_a_floor,
        )
