"""One term of a policy's observation, as a contract writes it down: what it means and every convention it depends on.

A convention that differs between sources is an option of the term, so that any wiring, a wrong one too, can be written
down. What kinds of terms there are is in `term_kinds`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.parameters import joint_tuple, number
from humanoid_sim.controllers.term_kinds import TERM_KINDS, TERM_NAMES, is_known
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import BASE, HEIGHT_SCAN, IMU, FloatArray, frozen_array

Frame = Literal["body", "world"]
OrientationLayout = Literal["rows", "columns", "two_rows"]
QuaternionOrder = Literal["wxyz", "xyzw"]
HistoryOrder = Literal["oldest_first", "newest_first"]
ActionForm = Literal["raw", "scaled"]
UPRIGHT = "x y z"
"""Axes of a vector that is shown as it is."""
_TURNS = tuple(f"{x} {y} {z}" for x, y, z in (
    ("y", "-x", "z"), ("-y", "x", "z"), ("-x", "-y", "z"), ("x", "z", "-y"), ("x", "-z", "y"), ("x", "-y", "-z"),
    ("-z", "y", "x"), ("z", "y", "-x"), ("-x", "y", "-z"),
))  # fmt: skip
"""Axes turned by a quarter, or by half, about z, x or y."""
RayOrder = Literal["xy", "yx"]
_CHOICES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "history_order": get_args(HistoryOrder),
        "frame": get_args(Frame),
        "layout": get_args(OrientationLayout),
        "quaternion": get_args(QuaternionOrder),
        "form": get_args(ActionForm),
    }
)
_MOST_RAYS = 2000
"""Rays of a height scan: as many values fit into one message of another program."""


@dataclass(frozen=True, slots=True)
class HeightScan:
    """A grid of points around a body, and the value made of the ground's height at each of them.

    The grid lies level and turns with the body's yaw. From each point a ray goes straight down; a value is the body's
    height less that of the ground, less `offset`. The defaults are mjlab's (`RayCastSensorCfg`, `GridPatternCfg` and
    `mdp.height_scan` of 1.6.0).
    """

    at: str = BASE
    """The body in the grid's middle: `base`, `imu`, or the name of a site or body."""
    grid: tuple[float, float] = (1.6, 1.0)
    """m, length along the body's x and y."""
    resolution: float = 0.1
    """m between two points."""
    ray_order: RayOrder = "xy"
    """The coordinate that changes first from one value to the next: `xy` for x, `yx` for y."""
    offset: float = 0.0
    """m"""
    range: float = 5.0
    """m, length of a ray."""
    miss: float | None = None
    """m, value of a ray that hits nothing; None: its range."""
    above: float = 0.0
    """m above the body where rays begin."""

    def __post_init__(self) -> None:
        """Check every option but `at`. Raises `FieldError` naming the option, its value and what is accepted."""
        owner, set_field = "HeightScan", object.__setattr__
        if len(self.grid) != 2:
            raise FieldError(f"{owner}.grid: is {list(self.grid)}, expected two lengths, along x and y")
        set_field(self, "grid", tuple(number(owner, "grid", side) for side in self.grid))
        for name, above in (("resolution", True), ("range", True), ("above", False)):
            set_field(self, name, number(owner, name, getattr(self, name), above=above))
        set_field(self, "offset", number(owner, "offset", self.offset, minimum=-np.inf))
        if self.miss is not None:
            set_field(self, "miss", number(owner, "miss", self.miss, minimum=-np.inf))
        if self.ray_order not in get_args(RayOrder):
            accepted = " or ".join(get_args(RayOrder))
            raise FieldError(f"{owner}.ray_order: is {self.ray_order!r}, expected {accepted}")
        if self.count > _MOST_RAYS:
            raise FieldError(f"{owner}.resolution: is {self.resolution:g}, {self.count} rays, expected <= {_MOST_RAYS}")

    @property
    def missed(self) -> float:
        """m, value of a ray that hits nothing."""
        return self.range if self.miss is None else self.miss

    @property
    def bounds(self) -> tuple[float, float]:
        """m, least and greatest value."""
        nearest = -self.above - self.offset
        return min(nearest, self.missed), max(nearest + self.range, self.missed)

    @property
    def count(self) -> int:
        """Number of rays."""
        columns, rows = self._sides
        return columns * rows

    @property
    def _sides(self) -> tuple[int, int]:
        """Points along x and y: those within the grid, however a multiple of the resolution is rounded."""
        return tuple(int(side / self.resolution + 1e-6) + 1 for side in self.grid)  # type: ignore[return-value]

    @property
    def points(self) -> FloatArray:
        """Shape (count, 2), m, x and y from the grid's middle, in the order of the values."""
        x, y = (np.arange(n) * self.resolution - 0.5 * side for n, side in zip(self._sides, self.grid, strict=True))
        if self.ray_order == "xy":
            return np.column_stack([np.tile(x, len(y)), np.repeat(y, len(x))])
        return np.column_stack([np.repeat(x, len(y)), np.tile(y, len(x))])


def _is_topic(name: object) -> bool:
    root, *parts = name.split("/") if isinstance(name, str) and name.isascii() else ("none",)
    return not root and bool(parts) and all(part.isidentifier() for part in parts)


SCAN_OPTIONS = tuple(field.name for field in fields(HeightScan) if field.name != "at")
"""Options of a term that only a height scan has."""


@dataclass(frozen=True, slots=True, eq=False)
class Term:
    """One observation term. Processing order: the value, its conventions, clip, scale, history."""

    name: str
    """As the exporter calls it."""
    kind: str = ""
    """Its meaning, a name of `TERM_KINDS` or `command`; empty: by its name. Any other is the name of a live input."""
    scale: FloatArray | float = 1.0
    """Scalar, or one factor per value. 0 feeds zeros."""
    clip: tuple[float, float] | None = None
    """Bounds before scaling."""
    history: int = 1
    """Number of policy steps that are shown, this one included."""
    history_order: HistoryOrder = "oldest_first"
    frame: Frame = "body"
    """For velocities and the anchor position."""
    at: str = BASE
    """For the velocity of the base, which point's: `base` for its origin, `imu`, or the name of a site; for a height
    scan, the middle of its grid, which may also be a body."""
    axes: str = UPRIGHT
    """For vectors in the IMU's frame, those of its axes that are shown as x, y and z, each with its sign: `y -x z`."""
    relative: bool | None = None
    """For joint positions (default true) and the motion command (default false): less the default pose."""
    layout: OrientationLayout = "rows"
    """Layout of six orientation values: the first two columns row by row, column by column, or the first two rows."""
    inverse: bool = False
    """For the anchor orientation: seen from the reference instead of from the robot."""
    quaternion: QuaternionOrder = "wxyz"
    """For terms that are quaternions."""
    form: ActionForm = "raw"
    """For the last action: the network's output, or that times the action scale."""
    joints: tuple[str, ...] | None = None
    """For joint positions and velocities: the joints shown, in this order; None: all, in the policy's order."""
    width: int | None = None
    """Number of values of a live input that no kind of term expresses; None: the kind's."""
    topic: str | None = None
    """Topic on which other programs publish a live input; None: the kind's."""
    timeout: float | None = None
    """s after its arrival from which a live input is stale, also infinite; None: 0.5, or what comes with the sample."""
    grid: tuple[float, float] | None = None
    """For a height scan, as the six options below: see `HeightScan`, whose default stands for None."""
    resolution: float | None = None
    ray_order: RayOrder | None = None
    offset: float | None = None
    range: float | None = None
    miss: float | None = None
    above: float | None = None

    def __post_init__(self) -> None:
        where = f"observation term '{self.name}'"
        set_field = object.__setattr__
        if not self.name or not isinstance(self.name, str):
            raise FieldError(f"observation term: its name is {self.name!r}, expected a text")
        meant = self.name if self.width is not None else TERM_NAMES.get(self.name, self.name)
        set_field(self, "kind", self.kind or meant)
        scale = frozen_array(where, "scale", self.scale)
        if scale.ndim > 1 or not np.isfinite(scale).all():
            raise FieldError(f"{where}: scale is {self.scale}, expected a finite number, or one per value")
        set_field(self, "scale", scale)
        if self.clip is not None:
            low, high = self.clip
            if not low <= high:
                raise FieldError(f"{where}: clip is {self.clip}, expected a lower and an upper bound")
            set_field(self, "clip", (float(low), float(high)))
        if isinstance(self.history, bool) or not isinstance(self.history, int) or self.history < 1:
            raise FieldError(f"{where}: history is {self.history!r}, expected a whole number >= 1")
        if self.joints is not None:
            set_field(self, "joints", joint_tuple(where, self.joints, "joints"))
        if not isinstance(self.at, str) or not self.at.strip():
            raise FieldError(f"{where}: at is {self.at!r}, expected base, imu or the name of a site")
        axes = self.axes.split() if isinstance(self.axes, str) else []
        if sorted(axis.removeprefix("-") for axis in axes) != ["x", "y", "z"]:
            raise FieldError(f"{where}: axes is {self.axes!r}, expected x, y and z in any order and sign, as 'y -x z'")
        set_field(self, "axes", " ".join(axes))
        if self.width is not None:
            self._check_width(where)
        self._check_topic(where)
        self._check_scan(where)
        for name, accepted in _CHOICES.items():
            if getattr(self, name) not in accepted:
                raise FieldError(f"{where}: {name} is {getattr(self, name)!r}, expected one of {', '.join(accepted)}")

    def _check_width(self, where: str) -> None:
        if isinstance(self.width, bool) or not isinstance(self.width, int) or self.width < 1:
            raise FieldError(f"{where}: width is {self.width!r}, expected a whole number >= 1")
        usual = TERM_KINDS.get(TERM_NAMES.get(self.kind, self.kind))
        if is_known(self.kind) and (usual is None or not usual.topic):
            raise FieldError(f"{where}: width is {self.width}, expected none: only a live input has one of its own")

    def _check_topic(self, where: str) -> None:
        for name in ("topic", "timeout"):
            value = getattr(self, name)
            if value is None or self.width is not None:
                continue
            if not is_known(self.kind):
                declared = f"{{name: {self.name}, width: 2}}"
                raise FieldError(f"{where}: {name} is {value!r}, but no width declares a live input: {declared}")
            usual = TERM_KINDS.get(self.kind)
            if usual is None or not usual.topic:
                raise FieldError(f"{where}: {name} is {value!r}, expected none: only a live input has one")
        if self.topic is not None and not _is_topic(self.topic):
            raise FieldError(f"{where}: topic is {self.topic!r}, expected a ROS 2 name such as '/foot_contact'")
        if self.timeout is not None:
            is_number = isinstance(self.timeout, int | float | np.floating) and not isinstance(self.timeout, bool)
            if not is_number or not self.timeout > 0.0:
                raise FieldError(f"{where}: timeout is {self.timeout!r}, expected seconds > 0, or .inf")
            object.__setattr__(self, "timeout", float(self.timeout))

    def _check_scan(self, where: str) -> None:
        if self.kind == HEIGHT_SCAN and self.width is None:
            try:
                scan = self.height_scan
            except FieldError as error:
                problem = str(error).removeprefix("HeightScan.").replace(": is", " is", 1)
                raise FieldError(f"{where}: {problem}") from None
            if self.grid is not None:
                object.__setattr__(self, "grid", scan.grid)
            return
        for name in SCAN_OPTIONS:
            if getattr(self, name) is not None:
                problem = f"{name} is {getattr(self, name)!r}, expected none: only a height_scan has one"
                raise FieldError(f"{where}: {problem}")

    @property
    def height_scan(self) -> HeightScan:
        """Grid of a term of that kind."""
        given = {name: getattr(self, name) for name in SCAN_OPTIONS if getattr(self, name) is not None}
        return HeightScan(self.at, **given)

    def process(self, value: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Clip, then scale, a value of shape (..., width)."""
        if self.clip is not None:
            value = np.clip(value, *self.clip)
        return value * self.scale

    def turned(self, vector: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Show a vector, shape (..., 3), along other axes, as `axes` has it."""
        axes = self.axes.split()
        signs = [-1.0 if axis.startswith("-") else 1.0 for axis in axes]
        return vector[..., ["xyz".index(axis[-1]) for axis in axes]] * signs

    def others(self, convention: str) -> tuple[str, ...]:
        """Return what an option with a choice of words could be instead."""
        if convention == "axes":
            return tuple(axes for axes in (UPRIGHT, *_TURNS) if axes != self.axes)
        if convention == "at":
            return (IMU,) if self.at == BASE else (BASE,)
        return tuple(choice for choice in _CHOICES[convention] if choice != getattr(self, convention))
