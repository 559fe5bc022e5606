"""The one table of observation terms: what each kind means, is made of, and depends on. A new term is one entry here.

Exporters give the same quantity different names, and `command` means whatever the contract's command is; `term_kind`
says what a name stands for.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers import term_values as values
from humanoid_sim.controllers.term_values import Bounds, Limits, Request, Resolve, Source
from humanoid_sim.errors import FieldError, known_names
from humanoid_sim.mit import (
    ANCHOR_POSE,
    BASE_LINEAR_VELOCITY,
    EXTERN_WIDTHS,
    HEIGHT_SCAN,
    KEY_PRESSED,
    VELOCITY_COMMAND,
    point_velocity,
)

if TYPE_CHECKING:  # contracts hold terms, and terms are named by this table
    from humanoid_sim.controllers.contract import PolicyContract
    from humanoid_sim.controllers.terms import Term

Convention = Literal["frame", "at", "axes", "relative", "layout", "inverse", "quaternion", "form", "sign"]


def _unnamed(_term: Term, _contract: PolicyContract) -> tuple[str, ...]:
    return ()


@dataclass(frozen=True, slots=True)
class TermKind:
    """Description of a kind of observation term, whatever the term is called."""

    name: str
    meaning: str
    """Meaning in words, with its unit."""
    resolve: Resolve
    """Width and value, before clip and scale."""
    _: KW_ONLY
    bounds: float | Bounds = 1.0
    """Largest magnitude on any robot, or least and greatest values, before clip and scale."""
    names: tuple[str, ...] = ()
    """Names that exporters use for it; empty: its own name."""
    reads: str = ""
    """The field of `MITState`, or the live input, that it is made of; empty: the policy's own memory, or its motion."""
    estimate: str = ""
    """Part of it that a simulation knows and a robot has to estimate."""
    conventions: tuple[Convention, ...] = ()
    """Conventions that may be flipped: options of `Term` that change the value, or its `sign`."""
    relative: bool = False
    """True if positions are relative to the default pose unless the term says otherwise."""
    task: Literal["", "tracking", "piano"] = ""
    """The task that a policy with such a term has; empty: any."""
    requires: str = ""
    """Field of the contract without which it means nothing."""
    scales: tuple[float, ...] = (1.0,)
    """Scales seen in the wild."""
    silent: str = ""
    """Likely cause of NaN values; empty if none is known."""
    topic: str = ""
    """Topic on which other programs publish it, where the term names none; empty: none does."""
    value_names: Callable[[Term, PolicyContract], tuple[str, ...]] = _unnamed
    """Joint of each value, where each has one."""

    def is_relative(self, term: Term) -> bool:
        """Return whether the positions of such a term are less the default pose."""
        return self.relative if term.relative is None else term.relative

    def input(self, term: Term) -> str:
        """Return the field of `MITState`, or the live input, that such a term is made of; empty as in `reads`."""
        return point_velocity(term.at) if "at" in self.conventions else self.reads

    def source(self, request: Request) -> tuple[int, Source]:
        """Width and value of a term of this kind. Raises `FieldError` if what the term needs is not there."""
        if request.term.kind == _COMMAND and not request.contract.command_names:
            name = request.term.name
            raise FieldError(
                f"observation term '{name}': the contract has no command_names, expected what it stands for"
            )
        if self.estimate and self.input(request.term) not in request.extern:
            what = self.input(request.term).replace("_", " ")
            raise request.missing(f"the robot's {what}: a simulation knows it, a robot needs an estimator for it")
        width, value = self.resolve(request)
        term = request.term
        if "axes" not in self.conventions or term.axes == "x y z":
            return width, value
        return width, lambda context: term.turned(value(context))

    def limits(self, request: Request, limits: Limits) -> tuple[npt.ArrayLike, npt.ArrayLike]:
        """Least and greatest values of a term of this kind, shape (width,) or scalar, before clip and scale."""
        if isinstance(self.bounds, float):
            return -self.bounds, self.bounds
        return self.bounds(request, limits)


_COMMAND = "command"


def term_kind(name: str, command_names: tuple[str, ...] = ()) -> TermKind:
    """Return the kind of a term by a name of it or of the kind; any other name is that of a live input.

    Args:
        name: as an exporter or a contract has it.
        command_names: of the contract; mjlab and Isaac Lab call motion and velocity commands alike.
    """
    if name == _COMMAND:
        name = "motion_command" if "motion" in command_names else "velocity_command"
    known = TERM_KINDS.get(TERM_NAMES.get(name, name))
    return known or TermKind(name, "live input", _live, bounds=_live_bounds, reads=name)


def live_kind(name: str) -> TermKind:
    """Return the kind of a live input of that name, whose width a term declares."""
    usual = TERM_KINDS.get(name)
    if usual is not None and usual.topic:
        return replace(usual, resolve=_live, bounds=_live_bounds)
    plain = "".join(letter if f"_{letter}".isidentifier() and letter.isascii() else "_" for letter in name)
    topic = f"/{plain}" if plain.isidentifier() else f"/_{plain}"
    silent = "no value has come, or the last one is too old"
    return TermKind(name, "live input", _live, bounds=_live_bounds, reads=name, silent=silent, topic=topic)


def is_known(name: str) -> bool:
    """Tell whether a kind of term, or something that a robot reports, has this name, which no live input may have."""
    is_reported = name in EXTERN_WIDTHS or name.startswith(BASE_LINEAR_VELOCITY)
    return name == _COMMAND or name in TERM_KINDS or name in TERM_NAMES or is_reported


_ANY_MAGNITUDE = 1e6
"""Largest magnitude of a declared live input, whose unit is not known."""


def _live(request: Request) -> tuple[int, Source]:
    name, width = request.kind.name, request.term.width
    if width is not None:
        if name not in request.extern:
            raise request.missing(f"the live input '{name}' of width {width} (fed through `live` from Python)")
        return values.declared(request)
    if name not in request.extern:
        unknown = known_names("observation term", request.term.name, sorted({*TERM_NAMES, *request.extern}))
        raise FieldError(f"{unknown}; a width declares a live input: {{name: {request.term.name}, width: 2}}")
    return values.live(request)


def _live_bounds(request: Request, _limits: Limits) -> tuple[npt.ArrayLike, npt.ArrayLike]:
    largest = 1.0 if request.term.width is None else _ANY_MAGNITUDE
    return -largest, largest


def _keys(request: Request) -> tuple[int, Source]:
    if request.kind.name not in request.extern:
        raise request.missing("a source of live key states: a piano, or a width of its own")
    return values.heard(request)


_KINDS = (  # in the order of the legged_gym and Isaac Lab task configurations that most others descend from
    TermKind(
        "base_lin_vel",
        "velocity of the base, m/s: needs an estimator",
        values.linear_velocity,
        bounds=100.0,
        reads=BASE_LINEAR_VELOCITY,
        estimate="the velocity of the base",
        conventions=("frame", "at", "axes"),
        scales=(1.0, 2.0),
    ),
    TermKind(
        "base_ang_vel",
        "angular velocity of the IMU, rad/s",
        values.angular_velocity,
        bounds=100.0,
        names=("base_ang_vel", "imu_ang_vel", "imu_angular_velocity"),
        reads="imu_angular_velocity",
        conventions=("frame", "axes"),
        scales=(1.0, 0.25, 0.2),
    ),
    TermKind(
        "projected_gravity",
        "direction of gravity in the body frame, (0, 0, -1) upright",
        values.gravity,
        reads="imu_quaternion",
        conventions=("sign", "axes"),
    ),
    TermKind(
        "imu_quaternion",
        "orientation of the IMU",
        values.imu_quaternion,
        reads="imu_quaternion",
        conventions=("quaternion",),
    ),
    TermKind(
        "velocity_command",
        "vx, vy in m/s and yaw rate in rad/s asked for",
        values.velocity_command(slice(0, 3)),
        bounds=10.0,
        names=("velocity_command", "velocity_commands", "twist"),
        reads=VELOCITY_COMMAND,
    ),
    TermKind(
        "command_lin_vel",
        "vx, vy asked for, m/s",
        values.velocity_command(slice(0, 2)),
        bounds=10.0,
        reads=VELOCITY_COMMAND,
        scales=(1.0, 2.0),
    ),
    TermKind(
        "command_ang_vel",
        "yaw rate asked for, rad/s",
        values.velocity_command(slice(2, 3)),
        bounds=10.0,
        reads=VELOCITY_COMMAND,
        scales=(1.0, 0.25),
    ),
    TermKind(
        "motion_command",
        "reference's joint positions and velocities, rad and rad/s",
        values.motion_command,
        bounds=values.motion_command_bounds,
        names=("motion_command", "motion"),
        conventions=("relative",),
        task="tracking",
        value_names=lambda _, contract: contract.joint_names * 2,
    ),
    TermKind(
        "motion_anchor_pos",
        "reference's anchor body from the robot's, m: needs an estimator",
        values.anchor_position,
        bounds=1000.0,
        names=("motion_anchor_pos_b",),
        reads=ANCHOR_POSE,
        estimate="the position of the anchor body",
        conventions=("frame",),
        task="tracking",
        requires="anchor_body",
    ),
    TermKind(
        "motion_anchor_ori",
        "reference's anchor orientation from the robot's, two columns of the matrix",
        values.anchor_orientation,
        names=("motion_anchor_ori_b", "motion_ref_ori_b"),
        reads=ANCHOR_POSE,
        estimate="the pose of the anchor body",
        conventions=("layout", "inverse"),
        task="tracking",
        requires="anchor_body",
    ),
    TermKind(
        "joint_pos",
        "joint positions, rad",
        values.joint_position,
        bounds=values.joint_position_bounds,
        names=("joint_pos", "joint_pos_rel", "dof_pos"),
        reads="joint_position",
        conventions=("relative",),
        relative=True,
        value_names=values.joint_names,
    ),
    TermKind(
        "joint_vel",
        "joint velocities, rad/s",
        values.joint_velocity,
        bounds=100.0,
        names=("joint_vel", "joint_vel_rel", "dof_vel"),
        reads="joint_velocity",
        scales=(1.0, 0.05, 0.1),
        value_names=values.joint_names,
    ),
    TermKind(
        "actions",
        "last action",
        values.last_action,
        bounds=values.action_bounds,
        names=("actions", "last_action"),
        conventions=("form",),
        value_names=lambda _, contract: contract.action_joint_names,
    ),
    TermKind("sin_phase", "sine of the gait phase of each foot", values.phase(np.sin), requires="phase"),
    TermKind("cos_phase", "cosine of the gait phase of each foot", values.phase(np.cos), requires="phase"),
    TermKind(
        "gait_phase",
        "sines, then cosines of the gait phase",
        values.phase(np.sin, np.cos),
        names=("gait_phase", "phase"),
        requires="phase",
    ),
    TermKind(
        "imu_linear_acceleration",
        "acceleration of the IMU, m/s²",
        values.acceleration,
        bounds=1e5,
        reads="imu_linear_acceleration",
        conventions=("axes",),
    ),
    TermKind(
        "motion_body_pos_b",
        "reference's body positions in the base frame, m",
        values.referenced,
        bounds=values.referenced_bounds,
        task="tracking",
        requires="body_names",
    ),
    TermKind(
        "motion_body_ori_b",
        "reference's body orientations in the base frame",
        values.referenced,
        bounds=values.referenced_bounds,
        task="tracking",
        requires="body_names",
    ),
    TermKind(
        "target_keys", "keys to press now, 0 or 1", values.referenced, bounds=values.referenced_bounds, task="piano"
    ),
    TermKind(
        "target_keys_future",
        "keys to press in the steps ahead",
        values.referenced,
        bounds=values.referenced_bounds,
        task="piano",
        requires="lookahead_steps",
    ),
    TermKind("progress", "how far into the motion, 0 to 1", values.progress),
    TermKind(
        "key_pressed",
        "keys that are down, 0 or 1",
        _keys,
        reads=KEY_PRESSED,
        silent="no key state has come, or the last one is too old",
        topic="/piano/key_state",
    ),
    TermKind(
        HEIGHT_SCAN,
        "height above the ground at the points of a grid, m",
        values.height_scan,
        bounds=values.height_scan_bounds,
        names=("height_scan", "height_scanner"),
        reads=HEIGHT_SCAN,
        scales=(1.0, 0.2),
        silent="no height scan has come, or the last one is too old",
        topic="/height_scan",
    ),
)

TERM_KINDS: Mapping[str, TermKind] = MappingProxyType({kind.name: kind for kind in _KINDS})
"""Every kind by its name."""
TERM_NAMES: Mapping[str, str] = MappingProxyType(
    {name: kind.name for kind in _KINDS for name in kind.names or (kind.name,)}
)
"""Every known name of a term, and its kind's."""
