"""One run of `prepare`, from options to files."""

from __future__ import annotations

import math
import re
import sys
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from humanoid_sim.assets import policy_path
from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import Checkpoint, load_checkpoint
from humanoid_sim.policy.motion import motion_bytes
from humanoid_sim.prepare import PrepareOptions
from humanoid_sim.prepare.acceptance import accept
from humanoid_sim.prepare.conventions import choose_conventions
from humanoid_sim.prepare.convert import convert, has_rate, resample
from humanoid_sim.prepare.lerobot_dataset import parse_roles, read_hub_dataset, read_local_dataset
from humanoid_sim.prepare.motion_files import read_csv, read_npz
from humanoid_sim.prepare.motion_fit import Tolerance
from humanoid_sim.prepare.outputs import Content, MotionReport, OutputFolder, checkpoint_files
from humanoid_sim.prepare.skeleton import Skeleton
from humanoid_sim.prepare.song import SONG_RATE, prepare_song
from humanoid_sim.prepare.source_motion import SourceMotion
from humanoid_sim.robots.description import load_robot


def prepare(options: PrepareOptions) -> int:
    """Run, and return the exit status. Raises `InputError` before any file is written."""
    _refuse_conflicts(options)
    console = Console(highlight=False, soft_wrap=not sys.stdout.isatty())
    outputs = OutputFolder(Path(options.output), options.overwrite)
    if options.song is not None and options.policy is None and options.wandb_run_path is None:
        outputs.write(prepare_song(options, 1.0 / (options.fps or SONG_RATE), console), console)
        return 0
    path = _checkpoint_path(options, console)
    description = load_robot(options.robot)
    contract_file = None if options.contract is None else Path(options.contract)
    checkpoint = load_checkpoint(path, contract_file, description.joint_names)
    has_source = options.motion is not None or options.dataset is not None
    task = checkpoint.contract.task_type
    if (task == "piano") is (options.song is None):
        needed = "plays songs: give one with --song" if task == "piano" else "plays no songs, and --song is given"
        raise InputError(f"{path}: is a policy of task_type {task}, which {needed}")
    if options.song is not None:
        _write(outputs, prepare_song(options, checkpoint.contract.policy_dt, console), checkpoint, path, console)
        return 0
    if task == "locomotion" and has_source:
        option = "--motion" if options.motion is not None else "--dataset"
        raise InputError(f"{option}: is given, but {path} follows no motion")
    if task == "locomotion" or (checkpoint.motion is not None and not has_source):
        why = "follows no motion" if task == "locomotion" else "carries its motion itself"
        _write(outputs, {}, checkpoint, path, console)
        console.print(f"{path.name}: {why}; nothing else to prepare", markup=False)
        return 0
    skeleton = Skeleton(description, checkpoint.contract)
    source = _read(options, checkpoint, skeleton, console)
    if options.velocities == "positions":
        if source.joint_position is None:
            raise InputError(f"--velocities: is positions, but {source.source} holds no joint positions")
        source = replace(source, joint_velocity=None)
    report = _make(options, checkpoint, skeleton, source)
    # The same check as `play` makes: terms, widths, bodies and rate.
    checkpoint.following(report.motion, source.source)
    name = options.name or _name(options, source)
    files: dict[str, Content] = {f"{name}.mcap": motion_bytes(report.motion), f"{name}.json": report.json_bytes()}
    outputs.refuse_existing(files)
    report.print(console)
    _write(outputs, files, checkpoint, path, console)
    return 0


def _write(
    outputs: OutputFolder, files: dict[str, Content], checkpoint: Checkpoint, path: Path, console: Console
) -> None:
    copies = checkpoint_files(checkpoint, path)
    if not copies:
        console.print(f"{path} is not copied: its contract is complete only with the files next to it", markup=False)
    outputs.write(files | copies, console)


def _refuse_conflicts(options: PrepareOptions) -> None:
    if (options.policy is None) == (options.wandb_run_path is None) and (options.song is None or options.policy):
        state = "both are given" if options.policy is not None else "neither is given"
        raise InputError(f"--policy and --wandb-run-path: {state}, expected one of them")
    if options.wandb_file is not None and options.wandb_run_path is None:
        raise InputError("--wandb-file: needs --wandb-run-path")
    given = [name for name in ("motion", "dataset", "song") if getattr(options, name) is not None]
    if len(given) > 1:
        raise InputError(f"--{given[0]} and --{given[1]}: both are given, expected one of them")
    if options.voices is not None and options.voices < 1:
        raise InputError(f"--voices: is {options.voices}, expected at least 1")
    values = {
        "--tolerance": options.tolerance,
        "--angle-tolerance": options.angle_tolerance,
        "--timeout": options.timeout,
    }
    if options.fps is not None:
        values["--fps"] = options.fps
    for option, value in values.items():
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(f"{option}: is {value}, expected a finite number > 0")
    if options.name is not None and not re.fullmatch(r"[\w.-]+", options.name):
        raise InputError(f"--name: is '{options.name}', expected letters, digits, '.', '_' and '-'")


def _checkpoint_path(options: PrepareOptions, console: Console) -> Path:
    if options.wandb_run_path is None:
        assert options.policy is not None  # one of the two is given
        return policy_path(options.policy)
    from humanoid_sim.prepare.wandb_run import fetch_checkpoint  # noqa: PLC0415 - only for this option

    path, notice = fetch_checkpoint(options.wandb_run_path, options.wandb_file, timeout=options.timeout)
    if notice:
        console.print(notice, markup=False)
    console.print(f"checkpoint {path}", markup=False)
    return path


def _read(options: PrepareOptions, checkpoint: Checkpoint, skeleton: Skeleton, console: Console) -> SourceMotion:
    """Return the source: a path, a dataset by id, or else the dataset that the checkpoint names."""
    roles = parse_roles(options.features)
    if options.motion is not None:
        return _read_path(options, Path(options.motion), roles, skeleton)
    dataset = options.dataset or checkpoint.contract.dataset_repo_id
    if not dataset:
        raise InputError(f"--motion: is missing, and {checkpoint.source} names no dataset")
    if options.dataset is None:
        console.print(f"motion: the dataset {dataset} that the checkpoint names", markup=False)
    return read_hub_dataset(dataset, options.episode, roles, skeleton.joints, options.timeout)


def _read_path(options: PrepareOptions, path: Path, roles: dict[str, str], skeleton: Skeleton) -> SourceMotion:
    if path.is_dir():
        return read_local_dataset(path, options.episode, roles, skeleton.joints)
    if not path.exists():
        raise InputError(f"--motion: '{path}' does not exist, expected an .npz or .csv file or a dataset's folder")
    suffix = path.suffix.lower()
    if suffix == ".csv":
        floating = skeleton.description.is_floating
        return read_csv(path, skeleton.joints, options.fps, floating=floating, quaternions=options.quaternions)
    if suffix != ".npz":
        raise InputError(f"--motion: '{path}' is neither an .npz or .csv file nor a folder")
    if options.fps is not None:
        raise InputError(f"--fps: is given, but {path} states its frame rate")
    return read_npz(path)


def _make(options: PrepareOptions, checkpoint: Checkpoint, skeleton: Skeleton, source: SourceMotion) -> MotionReport:
    """Check, resample and convert."""
    contract = checkpoint.contract
    tolerance = Tolerance(options.tolerance, math.radians(options.angle_tolerance))
    conventions = choose_conventions(source, skeleton, options)
    found = accept(source, conventions, skeleton, tolerance)
    same_rate = has_rate(source.fps, contract.policy_dt)
    if not same_rate and not options.resample:
        raise InputError(
            f"{source.source}: has {source.fps:g} frames per second, the policy takes {1.0 / contract.policy_dt:g} "
            "steps; add --resample to interpolate"
        )
    named = found.motion if same_rate else resample(found.motion, contract.policy_dt)
    motion, origin = convert(named, contract, skeleton)
    return MotionReport(source, checkpoint.source, conventions, tolerance, found, motion, origin, not same_rate)


def _name(options: PrepareOptions, source: SourceMotion) -> str:
    """Return a file name from the source's: `waltz` for waltz.npz, `dances_3` for episode 3 of a dataset of dances."""
    if options.motion is not None and Path(options.motion).is_file():
        return Path(options.motion).stem
    stem = re.sub(r"[^\w-]+", "_", source.source.rpartition("/")[2])
    return stem.replace("_episode_", "_").strip("_") or "motion"
