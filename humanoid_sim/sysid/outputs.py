"""Files of a fit: the robot, the ranges for training, everything as JSON, and a page."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from humanoid_sim.errors import InputError
from humanoid_sim.files import whole_file
from humanoid_sim.hardware.calibration import CalibrationEntry, load_calibration, save_calibration
from humanoid_sim.robots.description import robot_file
from humanoid_sim.robots.schema import RobotDescription
from humanoid_sim.strict_yaml import read_yaml
from humanoid_sim.sysid.fit import Fit, Fitted
from humanoid_sim.sysid.judgement import QUANTITIES, Judgement
from humanoid_sim.sysid.model import KINDS, UNITS

_DIGITS = 6
_ROBOT, _RANGES, _RESULTS, _PAGE, _CALIBRATION = (
    *("robot.yaml", "randomisation.yaml", "sysid.json", "sysid.html"),
    "calibration.yaml",
)


def robot_document(robot: str, description: RobotDescription, fit: Fit, folder: Path) -> dict[str, Any]:
    """Return the robot's own file with the fitted dynamics of its joints, for a file in `folder`."""
    path, label = robot_file(robot)
    document = {} if path.suffix == ".xml" else read_yaml(path, label)
    document = {**document, "mjcf": os.path.relpath(description.mjcf_path, folder.resolve())}
    dynamics = _dynamics(description, fit)
    joints = document.get("joints", {})
    if isinstance(joints, dict):
        changed = {name: {**joints.get(name, {}), "dynamics": values} for name, values in dynamics.items()}
        return document | {"joints": {**joints, **changed}}
    changed_list = [
        {**joint, "dynamics": dynamics[joint["name"]]} if joint["name"] in dynamics else joint for joint in joints
    ]
    return document | {"joints": changed_list}


def _dynamics(description: RobotDescription, fit: Fit) -> dict[str, dict[str, float]]:
    """Return by joint what was fitted, and what a fit before this one had found."""
    found: dict[str, dict[str, float]] = {}
    for joint in description.joints:
        if joint.dynamics is not None:
            known = {name: getattr(joint.dynamics, name) for name in KINDS if name != "offset"}
            found[joint.name] = {name: value for name, value in known.items() if value is not None}
    for item in fit.parameters:
        if item.is_decided and item.parameter.kind != "offset":
            for _, j in item.parameter.places:
                own = found.setdefault(description.joint_names[j], {})
                own[item.parameter.kind] = float(f"{item.value:.{_DIGITS}g}")
    return found


def randomisation_document(fit: Fit) -> dict[str, Any]:
    """Return fields of a `Randomisation` as wide as the widest interval of each kind, around the fitted robot."""
    widest: dict[str, float] = {}
    for item in fit.parameters:
        if item.is_decided:
            size = 1.0 if item.parameter.kind in ("offset", "delay") else max(item.value, 1e-9)
            widest[item.parameter.kind] = max(widest.get(item.parameter.kind, 0.0), item.half_width / size)
    document: dict[str, Any] = {}
    for kind, name in (("armature", "armature"), ("friction", "joint_friction"), ("torque_scale", "motor_strength")):
        if kind in widest:
            share = round(min(widest[kind], 0.9), 4)
            document[name] = [round(1.0 - share, 4), round(1.0 + share, 4)]
    if "offset" in widest:
        document["joint_position_bias"] = round(widest["offset"], 5)
    if "delay" in widest:  # a delay is drawn on top of the robot's own
        document["command_delay"] = [0.0, round(widest["delay"], 5)]
    return document


def results_document(description: RobotDescription, fit: Fit, judgement: Judgement, notes: list[str]) -> dict[str, Any]:
    """Return everything that was found, for programs."""
    names = description.joint_names
    errors = {
        name: {
            quantity: {"old": float(judgement.old[i, j]), "new": float(judgement.new[i, j])}
            for i, quantity in enumerate(QUANTITIES)
        }
        for j, name in enumerate(names)
    }
    return {
        "robot": description.name,
        "better": judgement.is_better,
        "ratio": dict(zip(QUANTITIES, judgement.ratio.tolist(), strict=True)),
        "parameters": [_row(item, names) for item in fit.parameters],
        "errors": errors,
        "unexplained": list(judgement.unexplained(names)),
        "notes": notes,
    }


def _row(item: Fitted, names: tuple[str, ...]) -> dict[str, Any]:
    parameter = item.parameter
    return {
        "name": parameter.name,
        "kind": parameter.kind,
        "unit": UNITS[parameter.kind],
        "joints": [names[j] for _, j in parameter.places],
        "old": parameter.old,
        "value": item.value,
        "half_width": item.half_width,
        "undecided": item.reason,
    }


def refuse_existing(folder: Path, calibration: Path | None, *, overwrite: bool) -> None:
    """Refuse a folder that has any of the files already. Raises `InputError` naming it."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--output: '{folder}' is not a folder")
    names = (_ROBOT, _RANGES, _RESULTS, _PAGE, *((_CALIBRATION,) if calibration is not None else ()))
    for name in names:
        if not overwrite and (folder / name).exists():
            raise InputError(f"{folder / name}: exists; --overwrite replaces it")


def write_files(
    folder: Path,
    robot: str,
    description: RobotDescription,
    fit: Fit,
    results: Mapping[str, Any],
    page: str,
    calibration: Path | None,
) -> list[Path]:
    """Write all files into the folder, made if it is missing; returns them."""
    folder.mkdir(parents=True, exist_ok=True)
    texts = {
        _ROBOT: f"# {description.name} with the dynamics of its joints that `python -m humanoid_sim.sysid` fitted.\n"
        + yaml.safe_dump(robot_document(robot, description, fit, folder), sort_keys=False, allow_unicode=True),
        _RANGES: "# Ranges as wide as the intervals of the fit, around the fitted robot.\n"
        + yaml.safe_dump(randomisation_document(fit), sort_keys=False),
        _RESULTS: json.dumps(results, indent=1) + "\n",
        _PAGE: page,
    }
    for name, text in texts.items():
        with whole_file(folder / name) as file:
            file.write(text.encode())
    written = [folder / name for name in texts]
    if calibration is not None:
        save_calibration(folder / _CALIBRATION, _corrected(calibration, description, fit))
        written.append(folder / _CALIBRATION)
    return written


def _corrected(path: Path, description: RobotDescription, fit: Fit) -> dict[str, CalibrationEntry]:
    """Return a calibration without the offsets that were found. Raises `InputError` as `load_calibration`."""
    entries = dict(load_calibration(path, description).entries)
    for item in fit.parameters:
        if item.is_decided and item.parameter.kind == "offset":
            joint = description.joints[item.parameter.places[0][1]]
            if joint.motor is not None and joint.name in entries:  # a joint that reads too much has too low a zero
                entry = entries[joint.name]
                offset = entry.homing_offset + joint.motor.direction * item.value
                entries[joint.name] = replace(entry, homing_offset=offset)
    return entries
