"""Motions as their sources have them: `.npz` of mjlab and whole_body_tracking, `.csv`, joint states, LeRobot (v3.0)."""

from __future__ import annotations

import importlib.util
import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from mcap.reader import make_reader

from humanoid_sim.controllers.contract import QuaternionOrder
from humanoid_sim.controllers.rotation import quaternion_from_matrix, rotation_from_6d
from humanoid_sim.errors import InputError, blaming, needing, require_known
from humanoid_sim.files import read_arrays, regular_file
from humanoid_sim.mit import FloatArray
from humanoid_sim.names import list_joints
from humanoid_sim.ros2.cdr import decode
from humanoid_sim.ros2.definitions import JOINT_STATE

_UNIT = 0.02  # largest distance of a quaternion's norm from 1: rounding and interpolation leave much less
_LONGEST_GAP = 0.1  # s between two frames, if that is also more than three of the usual steps
_LONGEST_STEP = 1.0  # s between two frames of what is a motion still
_JOINT_SUFFIXES = ("", ".pos", "_pos", "_dof")  # that exporters append to a joint's name
_NPZ_KEYS = ("fps", "joint_pos", "joint_vel", "body_pos_w", "body_quat_w")
_BASE_COLUMNS = ("base_x", "base_y", "base_z", "base_qw", "base_qx", "base_qy", "base_qz")
_FORMAT = "v3.0"  # of LeRobot
_WIDTHS = {"body_pos_w": 3, "body_quat_w": 4, "motion_body_pos_b": 3, "motion_body_ori_b": 6}
_ROLES = ("joint_pos", "joint_vel", *_WIDTHS)
"""Parts of a motion; a feature whose name ends in one of them is it, and one that ends in `state` joint positions."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SourceMotion:
    """One episode of F frames; a pose is a position, m, and a unit quaternion. What the source does not say is None."""

    source: str
    times: FloatArray  # shape (F,), s
    joints: FloatArray | None = None  # positions, shape (F, n), rad, or degrees as the user says
    joint_velocity: FloatArray | None = None  # shape (F, n), per second
    joint_names: tuple[str, ...] | None = None
    base: FloatArray | None = None  # pose of the robot's base body in the world, shape (F, 7)
    bodies: FloatArray | None = None  # poses in `frame`, shape (F, B, 7)
    body_names: tuple[str, ...] | None = None
    frame: Literal["world", "base"] = "world"
    quaternion_order: QuaternionOrder | None = None

    def __post_init__(self) -> None:
        for name, array in {"times": self.times, **self.arrays()}.items():
            if len(array) != len(self.times) or not array.size:
                raise InputError(
                    f"{self.source}: {name} has shape {array.shape}, expected {len(self.times)} frames, > 0"
                )
            if not np.isfinite(array).all():
                frame, *place = np.argwhere(~np.isfinite(array))[0].tolist()
                raise InputError(f"{self.source}: {name} is not finite in frame {frame}, at {place}")
            norm = np.sqrt((array[..., 3:] ** 2).sum(axis=-1)) if name in ("base", "bodies") else np.ones(1)
            if np.abs(norm - 1.0).max() > _UNIT:
                norms = f"{norm.min():.3g} to {norm.max():.3g}, expected 1"
                raise InputError(f"{self.source}: {name} has quaternions of norm {norms}")
        steps = np.diff(self.times)
        longest = min(max(_LONGEST_GAP, 3.0 * float(np.median(steps))), _LONGEST_STEP) if steps.size else np.inf
        if (wrong := (steps <= 0.0) | (steps > longest)).any():
            frame = int(np.argmax(wrong)) + 1
            accepted = f"times in s that increase, by at most {longest:g} s"
            step = f"frame {frame} comes {steps[frame - 1]:g} s after the one before"
            raise InputError(f"{self.source}: {step}, expected {accepted}")

    def arrays(self) -> dict[str, FloatArray]:
        """Return what the source holds, by field; each of F rows."""
        held = {field: getattr(self, field) for field in ("joints", "joint_velocity", "base", "bodies")}
        return {field: array for field, array in held.items() if array is not None}

    @property
    def rate(self) -> float:
        """Mean frames per second; 0 for a single frame."""
        count = len(self.times)
        return (count - 1) / float(self.times[-1] - self.times[0]) if count > 1 else 0.0


def derivative(joints: FloatArray, times: FloatArray) -> FloatArray:
    """Return the central differences of (F, n), one-sided at the ends; zeros of a single frame."""
    return np.asarray(np.gradient(joints, times, axis=0) if len(times) > 1 else np.zeros_like(joints))


def _even_times(count: int, fps: float, source: str) -> FloatArray:
    if not 0.0 < fps < np.inf:
        raise InputError(f"{source}: fps is {fps:g}, expected a positive number of frames per second")
    return np.asarray(np.arange(count) / fps)


def _joint_of(column: str, joints: tuple[str, ...]) -> str | None:
    """Return the joint whose position a column is by its name; None if there is none."""
    names = (column.removesuffix(suffix) for suffix in _JOINT_SUFFIXES if column.endswith(suffix))
    return next((name for name in names if name in joints), None)


def require_each(where: str, wanted: Sequence[str], names: Sequence[str]) -> None:
    """Raise an `InputError`, which `where` begins, unless each wanted name is among the names once."""
    lacking = [name for name in wanted if name not in names]
    twice = [name for name in wanted if names.count(name) > 1]
    if lacking or twice:
        problem = f"lacks {list_joints(lacking)}" if lacking else f"has {list_joints(twice)} more than once"
        raise InputError(f"{where}: {problem}")


def read_npz(path: Path) -> SourceMotion:
    """Read a motion of mjlab or whole_body_tracking, whose files do not name joints or bodies."""
    arrays = read_arrays(path)
    missing = [key for key in _NPZ_KEYS if key not in arrays]
    if missing:
        raise InputError(f"{path}: has no {', '.join(missing)}; it holds {', '.join(sorted(arrays)) or 'nothing'}")
    shapes = ", ".join(f"{key} {arrays[key].shape}" for key in _NPZ_KEYS[1:])
    with blaming(f"{path}: has {shapes}, expected (F, n), (F, n), (F, B, 3), (F, B, 4)", Exception):
        fps, joints, velocity, position, quaternion = (arrays[key].astype(np.float64) for key in _NPZ_KEYS)
        count, width = joints.shape
        bodies = np.concatenate([position.reshape(count, -1, 3), quaternion.reshape(count, -1, 4)], axis=-1)
        times, velocity = _even_times(count, float(fps.flat[0]), str(path)), velocity.reshape(count, width)
        named = {"joint_names", "body_names"} & arrays.keys()  # some writers have bytes
        names = {key: tuple(arrays[key].astype(str).ravel().tolist()) for key in named}
    return SourceMotion(
        source=str(path),
        times=times,
        joints=joints,
        joint_velocity=velocity,
        joint_names=names.get("joint_names"),
        bodies=bodies,
        body_names=names.get("body_names"),
    )


def read_csv(path: Path, joints: tuple[str, ...], fps: float | None) -> SourceMotion:
    """Read a table with a frame a line: with column names in any order, or as LAFAN1's for the G1, base and joints."""
    with blaming(f"{path}: is not a table of numbers with commas", (OSError, ValueError)):
        text = regular_file(path, "a .csv file").read_text(encoding="utf-8-sig")
        lines = [line for line in text.splitlines() if line.strip()]
        has_names = bool(lines) and re.search("[a-df-z]", lines[0], re.IGNORECASE) is not None  # e: 1e-3
        if len(lines) <= has_names:
            raise InputError(f"{path}: has no frames")
        table = np.loadtxt(lines[has_names:], delimiter=",", ndmin=2)
    if has_names:
        parts = [_joint_of(name.strip(' "#'), joints) or name.strip(' "#') for name in lines[0].split(",")]
    else:
        parts = [*_BASE_COLUMNS, *joints] if table.shape[1] > len(joints) else list(joints)
    require_known("column", parts, ("time", *_BASE_COLUMNS, *joints), f"{path}: ")
    has_base = not set(parts).isdisjoint(_BASE_COLUMNS)
    require_each(str(path), (*_BASE_COLUMNS, *joints) if has_base else joints, parts)
    if len(parts) != table.shape[1]:
        counts = f"{len(joints)} joints, or {len(_BASE_COLUMNS) + len(joints)} with the base's pose before them"
        accepted = f"{len(parts)}, as in its first line" if has_names else counts
        raise InputError(f"{path}: has {table.shape[1]} columns, expected {accepted}")
    if (fps is None) == ("time" not in parts):
        raise InputError(f"--fps: is {fps}, expected it where there is no column 'time', and only there")
    return SourceMotion(
        source=str(path),
        times=table[:, parts.index("time")] if fps is None else _even_times(len(table), fps, "--fps"),
        joints=table[:, [parts.index(name) for name in joints]],
        joint_names=joints if has_names else None,
        base=table[:, [parts.index(name) for name in _BASE_COLUMNS]] if has_base else None,
        quaternion_order="wxyz" if has_names else None,
    )


def read_joint_states(path: Path, topic: str | None, joints: tuple[str, ...]) -> SourceMotion:
    """Read `sensor_msgs/msg/JointState` with joints of the robot from an MCAP file."""
    found: dict[str, list[tuple[float, list[float]]]] = {}
    others: tuple[str, ...] = ()
    regular_file(path, "an MCAP file", None)
    with (
        blaming(f"{path}: is not a whole MCAP file of joint states (`mcap recover` repairs a cut one)", Exception),
        path.open("rb") as stream,
    ):
        for schema, channel, message in make_reader(stream).iter_messages():
            if schema is None or schema.name != JOINT_STATE:
                continue
            rows = found.setdefault(channel.topic, [])
            (seconds, nanoseconds), _, names, values, *_ = decode(JOINT_STATE, message.data)
            position = dict(zip(names, values.tolist(), strict=False))
            if topic not in (None, channel.topic) or position.keys().isdisjoint(joints):
                others = tuple(position)
                continue
            require_each(f"{path}: {channel.topic}", joints, names[: len(values)])
            time = seconds + 1e-9 * nanoseconds or 1e-9 * message.log_time  # some headers have no time
            rows.append((time, [position[joint] for joint in joints]))
    if not found:
        raise InputError(f"{path}: has no topic of {JOINT_STATE}, expected the joint states of a robot")
    if topic is not None:
        require_known("topic of joint states", [topic], found, f"{path}: --topic: ")
    filled = [rows for rows in found.values() if rows]
    if not filled:
        theirs = f"has {list_joints(others)}, none of the robot's joints"
        raise InputError(f"{path}: {', '.join(found)} {theirs}: {list_joints(joints)}")
    if len(filled) > 1:
        raise InputError(f"--topic: is missing, {path} has joint states on {', '.join(found)}")
    times, positions = (np.array(column) for column in zip(*filled[0], strict=True))
    return SourceMotion(source=str(path), times=times, joints=positions, joint_names=joints)


def dataset_folder(name: str) -> Path:
    """Return the folder of a dataset: a path, LeRobot's own copy of one on the hub, or fetched, without its videos."""
    if Path(name).is_dir():
        if (Path(name) / "metadata.yaml").exists():
            accepted = "the .mcap file in it (of .db3 `ros2 bag convert` makes one)"
            raise InputError(f"--motion: '{name}' is a folder of rosbag2, expected {accepted}")
        return Path(name)
    if name.count("/") != 1 or Path(name).exists():
        accepted = "an .npz, .csv or .mcap file, a folder, or user/name on the hub"
        raise InputError(f"--motion: is '{name}', expected {accepted}")
    cache = os.environ.get("HF_HOME", "~/.cache/huggingface")
    kept = Path(os.environ.get("HF_LEROBOT_HOME", f"{cache}/lerobot")).expanduser() / name
    if (kept / "meta").is_dir():
        return kept
    with needing("huggingface_hub", "lerobot", f"fetching the dataset '{name}'"):
        from huggingface_hub import snapshot_download  # noqa: PLC0415 - optional
    with blaming(f"--motion: '{name}' cannot be fetched from the hub", Exception):  # of the network, or its own
        return Path(snapshot_download(name, repo_type="dataset", allow_patterns=["meta/*", "data/*"]))


def _converter() -> str:
    """Return the command of the installed LeRobot that converts a dataset of format v2.1; its name if there is none."""
    name, lerobot = "convert_dataset_v21_to_v30", importlib.util.find_spec("lerobot")
    for folder in (lerobot and lerobot.submodule_search_locations) or ():
        for file in Path(folder).rglob(f"{name}.py"):
            return f"python -m {'.'.join(('lerobot', *file.relative_to(folder).with_suffix('').parts))}"
    return f"LeRobot's {name}"


def read_dataset(folder: Path, episode: int | None, joints: tuple[str, ...]) -> SourceMotion:
    """Read one episode of a dataset. LeRobot is not needed."""
    with needing("pyarrow", "lerobot", "reading a LeRobot dataset"):
        from pyarrow import compute, parquet  # noqa: PLC0415 - optional
    with blaming(f"{folder}: cannot be read as a LeRobot dataset", Exception):
        info = json.loads(regular_file(folder / "meta" / "info.json", "a dataset's info.json").read_bytes())
        if info["codebase_version"] != _FORMAT:
            found = f"has format {info['codebase_version']}, expected {_FORMAT}"
            raise InputError(f"{folder}: {found}; convert it with {_converter()}")
        wanted = ["episode_index", "data/chunk_index", "data/file_index"]
        listed = parquet.read_table(folder / "meta" / "episodes", columns=wanted).to_pylist()
        rows = {row["episode_index"]: row for row in listed}
        chosen = 0 if episode is None and len(rows) == 1 else episode
        if chosen not in rows:
            found = "missing" if chosen is None else f"is {chosen}"
            raise InputError(f"--episode: {found}, expected one of the {len(rows)} episodes of {folder}, from 0")
        place = {name: rows[chosen][f"data/{name}"] for name in ("chunk_index", "file_index")}
        numeric = {key: its for key, its in info["features"].items() if its["dtype"].startswith(("float", "int"))}
        table = parquet.read_table(folder / info["data_path"].format(**place), columns=[*numeric])
        table = table.filter(compute.equal(table["episode_index"], chosen))
        columns = {key: np.array(table[key].to_pylist(), dtype=np.float64) for key in numeric}
        names = {key: _value_names(its.get("names")) for key, its in numeric.items()}
        return _episode(f"{folder} episode {chosen}", columns, names, joints)


def _value_names(names: Any) -> list[str]:
    """Return a feature's names of its values; some writers nest them as `{"motors": [...]}`."""
    nested = names.values() if isinstance(names, Mapping) else [names or []]
    return [str(name) for listed in nested for name in listed]


def _episode(
    source: str, columns: Mapping[str, FloatArray], names: Mapping[str, list[str]], joints: tuple[str, ...]
) -> SourceMotion:
    """Return the motion in an episode's numeric features, each (F, …), whose values have names or none."""
    found: dict[str, str] = {}  # feature of each role; `reference.*` comes first
    for key in [key for key in columns if key.startswith("reference.")] or columns:
        role = key.rpartition(".")[2].replace("state", "joint_pos")
        if role in _ROLES and columns[key].ndim > 1:
            if role in found:
                raise InputError(f"{source}: '{found[role]}' and '{key}' may both be {role}, expected one")
            found[role] = key
    if not {"joint_pos", "body_pos_w", "motion_body_pos_b"} & found.keys():
        raise InputError(f"{source}: holds no motion, but {', '.join(columns)}; expected one that ends in joint_pos")
    arrays = {role: columns[feature] for role, feature in found.items()}
    listed = names.get(found.get("joint_pos", ""), [])
    places = [_joint_of(name, joints) or name for name in listed]
    is_named = not set(joints).isdisjoint(places)
    if is_named:
        require_each(f"{source}: {found['joint_pos']}", joints, places)
        for role in {"joint_pos", "joint_vel"} & arrays.keys():
            arrays[role] = arrays[role][:, [places.index(joint) for joint in joints]]
    for role in _WIDTHS.keys() & arrays.keys():
        arrays[role] = arrays[role].reshape(len(arrays[role]), -1, _WIDTHS[role])
    if "motion_body_ori_b" in arrays:
        arrays["body_quat_b"] = quaternion_from_matrix(rotation_from_6d(arrays["motion_body_ori_b"]))
    frame: Literal["world", "base"] = "world" if "body_pos_w" in arrays else "base"
    place, turn = ("body_pos_w", "body_quat_w") if frame == "world" else ("motion_body_pos_b", "body_quat_b")
    if (place in arrays) != (turn in arrays):
        raise InputError(f"{source}: holds positions or orientations of bodies, expected both")
    heads = tuple(name.rpartition(".")[0] for name in names.get(found.get(place, ""), [])[::3])  # hand.x, hand.y, …
    return SourceMotion(
        source=source,
        times=columns["timestamp"],
        joints=arrays.get("joint_pos"),
        joint_velocity=arrays.get("joint_vel"),
        joint_names=joints if is_named else None,
        bodies=np.concatenate([arrays[place], arrays[turn]], axis=-1) if place in arrays else None,
        body_names=heads if heads and all(heads) else None,
        frame=frame,
        quaternion_order="wxyz" if frame == "base" else None,
    )
