"""Features of a dataset that hold a motion: by the usual names, or by those that the user gives."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from humanoid_sim.controllers.rotation import quaternion_from_matrix, rotation_from_6d
from humanoid_sim.errors import InputError, meant
from humanoid_sim.mit import FloatArray
from humanoid_sim.prepare.source_motion import SourceMotion, joint_of

ROLES: Mapping[str, tuple[str, ...]] = {
    "joint_pos": ("joint_pos", "joint_position", "joint_positions", "qpos", "state"),
    "joint_vel": ("joint_vel", "joint_velocity", "joint_velocities", "velocity"),
    "body_pos_b": ("motion_body_pos_b", "body_pos_b"),
    "body_ori_b": ("motion_body_ori_b", "body_ori_b"),
    "body_quat_b": ("body_quat_b",),
    "body_pos_w": ("body_pos_w",),
    "body_quat_w": ("body_quat_w",),
    "base_pos": ("base_pos", "root_pos", "base_position"),
    "base_quat": ("base_quat", "root_quat", "base_orientation"),
}
"""Roles of features, and the last part of the names under which each is known, the surest first."""

_LAST_AXIS = {"body_pos_b": 3, "body_ori_b": 6, "body_quat_b": 4, "body_pos_w": 3, "body_quat_w": 4}
_GAPS = 0.1
"""Share of a frame that timestamps may be off."""


def parse_roles(options: Iterable[str]) -> dict[str, str]:
    """`--features joint_pos=observation.qpos …` as a mapping from role to feature."""
    roles = {}
    for option in options:
        role, equals, feature = option.partition("=")
        if not equals or role not in ROLES or not feature:
            near = "" if role in ROLES else meant(role, ROLES)
            raise InputError(
                f"--features: is '{option}'{near}, expected ROLE=FEATURE with a role of {', '.join(ROLES)}"
            )
        roles[role] = feature
    return roles


def episode_motion(
    source: str,
    columns: Mapping[str, FloatArray],
    names: Mapping[str, Any],
    fps: float,
    roles: Mapping[str, str],
    joint_names: tuple[str, ...],
) -> SourceMotion:
    """Return the motion in an episode's columns.

    Raises `InputError` if the columns hold no motion, or one that contradicts itself.

    Args:
        columns: numeric features, each (F, …).
        names: what the dataset calls the values of each feature, if it does.
        roles: features whose names are not the usual ones, by role.
    """
    found = _find(source, columns, roles)
    _check_times(source, columns.get("timestamp"), fps)
    joints, joint_columns = _joints(source, columns, found, names, joint_names)
    world = "body_pos_w" in found
    suffix = "w" if world else "b"
    position = _bodies(source, columns, found, f"body_pos_{suffix}")
    quaternion = _bodies(source, columns, found, f"body_quat_{suffix}")
    if quaternion is None and not world:
        columns_6d = _bodies(source, columns, found, "body_ori_b")
        quaternion = None if columns_6d is None else quaternion_from_matrix(rotation_from_6d(columns_6d))
    count = 0 if position is None else position.shape[1]
    velocity = columns[found["joint_vel"]] if "joint_vel" in found else None
    if "joint_pos" not in found and position is None:
        raise InputError(
            f"{source}: has no feature with joint positions or body poses; it has {', '.join(sorted(columns))}; "
            "say which is which with --features joint_pos=…"
        )
    return SourceMotion(
        source=source,
        kind="lerobot",
        fps=fps,
        joint_position=columns[found["joint_pos"]][:, joint_columns] if "joint_pos" in found else None,
        joint_velocity=velocity if velocity is not None and velocity.shape[1] == len(joint_columns) else None,
        joint_names=joints,
        body_position=position,
        body_quaternion=quaternion,
        body_names=() if position is None else _body_names(names.get(found[f"body_pos_{suffix}"]), count),
        base_position=columns[found["base_pos"]] if "base_pos" in found else None,
        base_quaternion=columns[found["base_quat"]] if "base_quat" in found else None,
        frame="world" if world else "base",
    )


def _find(source: str, columns: Mapping[str, FloatArray], roles: Mapping[str, str]) -> dict[str, str]:
    found = {}
    for role, feature in roles.items():
        if feature not in columns:
            lacks = f"{source} has no feature '{feature}'{meant(feature, columns)}"
            raise InputError(f"--features: {lacks}; it has {', '.join(sorted(columns))}")
        found[role] = feature
    # What `record_dataset --reference` adds: the motion itself, next to what the robot made of it.
    references = [key for key in columns if key.startswith("reference.")]
    for role, known in ROLES.items():
        for word in known:
            keys = [key for key in references or columns if key.rpartition(".")[2] == word and columns[key].ndim > 1]
            if len(keys) > 1:
                keys = [key for key in keys if key.startswith("observation.")] or keys
            if role not in found and keys:
                found[role] = keys[0]
    return found


def _joints(
    source: str,
    columns: Mapping[str, FloatArray],
    found: Mapping[str, str],
    names: Mapping[str, Any],
    joint_names: tuple[str, ...],
) -> tuple[tuple[str, ...] | None, list[int]]:
    """Names of the joint columns as the dataset has them, and which columns they are; no names: all columns."""
    if "joint_pos" not in found:
        return None, []
    listed = _flat(names.get(found["joint_pos"]))
    places: dict[str, int] = {}
    for place, name in enumerate(listed):
        joint = joint_of(name, joint_names)
        if joint is not None:
            places.setdefault(joint, place)
    if not places:
        return None, list(range(columns[found["joint_pos"]].shape[1]))
    missing = [joint for joint in joint_names if joint not in places]
    if missing:
        raise InputError(f"{source}: feature '{found['joint_pos']}' has no {', '.join(missing)}")
    return tuple(places), list(places.values())


def _bodies(source: str, columns: Mapping[str, FloatArray], found: Mapping[str, str], role: str) -> FloatArray | None:
    """Return a feature of bodies as (F, B, 3), (F, B, 4) or (F, B, 6), whether it is stored flat or not."""
    if role not in found:
        return None
    array, width = columns[found[role]], _LAST_AXIS[role]
    if array.ndim == 2 and array.shape[1] % width == 0:
        return array.reshape(len(array), -1, width)
    if array.ndim == 3 and array.shape[2] == width:
        return array
    raise InputError(
        f"{source}: feature '{found[role]}' has shape {array.shape[1:]} per frame, expected {width} values per body"
    )


def _body_names(names: Any, count: int) -> tuple[str, ...]:
    """Names of bodies from names of values: `left_hand.x, left_hand.y, …`, or one name per body."""
    listed = _flat(names)
    if len(listed) == count:
        return tuple(listed)
    heads = [name.rpartition(".")[0] for name in listed]
    bodies = list(dict.fromkeys(heads))
    if all(heads) and len(bodies) == count and heads == [body for body in bodies for _ in range(3)]:
        return tuple(bodies)
    return ()


def _flat(names: Any) -> list[str]:
    """Return a dataset's names as a list: some writers nest them as `{"motors": [...]}`."""
    if isinstance(names, Mapping):
        return [name for value in names.values() for name in _flat(value)]
    if isinstance(names, str):
        return [names]
    return [text for name in names or () for text in _flat(name)]


def _check_times(source: str, times: FloatArray | None, fps: float) -> None:
    """Frames must be as far apart as the dataset's frame rate says."""
    if times is None or len(times) < 2:
        return
    steps = np.diff(times.reshape(-1))
    worst = int(np.abs(steps - 1.0 / fps).argmax())
    if abs(steps[worst] * fps - 1.0) > _GAPS:
        raise InputError(
            f"{source}: timestamp rises by {steps[worst]:.4g} s after frame {worst}, but fps is {fps:g}; "
            f"expected {1.0 / fps:.4g} s"
        )
