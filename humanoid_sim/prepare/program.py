"""One run of `prepare`, from options to files."""

from __future__ import annotations

import hashlib
import math
import re
import sys
from collections.abc import Callable
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn

from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import Checkpoint, load_checkpoint
from humanoid_sim.policy.loaded_policy import load_policy
from humanoid_sim.policy.motion import Motion, motion_bytes
from humanoid_sim.prepare.config import PrepareConfig
from humanoid_sim.prepare.conventions import choose_conventions
from humanoid_sim.prepare.convert import convert
from humanoid_sim.prepare.examine import Robot, examine
from humanoid_sim.prepare.features import parse_roles
from humanoid_sim.prepare.outputs import Content, Outputs, checkpoint_files, report_bytes
from humanoid_sim.prepare.report import MotionReport, print_report
from humanoid_sim.prepare.resample import has_rate, resample
from humanoid_sim.prepare.skeleton import Skeleton
from humanoid_sim.prepare.source import SourceMotion
from humanoid_sim.prepare.verify import Tolerance, Verifier
from humanoid_sim.robots.description import load_robot

__all__ = ["prepare"]


def prepare(config: PrepareConfig) -> int:
    """Run, and return the exit status.

    Raises:
        InputError: before any file is written.
    """
    _refuse_conflicts(config)
    console = Console(highlight=False, soft_wrap=not sys.stdout.isatty())
    outputs = Outputs(Path(config.output), config.overwrite)
    path = _checkpoint_path(config, console)
    description = load_robot(config.robot)
    contract_file = None if config.contract is None else Path(config.contract)
    checkpoint = load_checkpoint(path, contract_file, description.joint_names)
    has_source = config.motion is not None or config.dataset is not None
    task = checkpoint.contract.task_type
    if task == "piano":
        raise InputError(f"{path}: is a piano policy, and songs cannot be prepared by this version yet")
    if task == "locomotion" and has_source:
        option = "--motion" if config.motion is not None else "--dataset"
        raise InputError(f"{option}: is given, but {path} follows no motion")
    if task == "locomotion" or (checkpoint.motion is not None and not has_source):
        why = "follows no motion" if task == "locomotion" else "carries its motion itself"
        _write(outputs, {}, checkpoint, path, console)
        console.print(f"{path.name}: {why}; nothing else to prepare", markup=False)
        return 0
    skeleton = Skeleton(description)
    robot = Robot(description, skeleton, Verifier(description, skeleton))
    source = _read(config, checkpoint, robot, console)
    motion, report = _make(config, checkpoint, robot, source)
    # The same check as `play` makes: terms, widths, bodies and rate.
    load_policy(
        checkpoint.contract,
        checkpoint.policy,
        motion,
        checkpoint.observation_width,
        source=checkpoint.source,
        motion_source=source.source,
    )
    name = config.name or _name(config, source)
    files: dict[str, Content] = {f"{name}.mcap": motion_bytes(motion), f"{name}.json": report_bytes(report)}
    outputs.refuse_existing(files)
    print_report(console, report)
    _write(outputs, files, checkpoint, path, console)
    return 0


def _write(outputs: Outputs, files: dict[str, Content], checkpoint: Checkpoint, path: Path, console: Console) -> None:
    copies = checkpoint_files(checkpoint, path)
    if not copies:
        console.print(f"{path} stays where it is: its contract is complete only with the files beside it", markup=False)
    outputs.write(files | copies, console)


def _refuse_conflicts(config: PrepareConfig) -> None:
    if (config.policy is None) == (config.wandb_run_path is None):
        state = "both are given" if config.policy is not None else "neither is given"
        raise InputError(f"--policy and --wandb-run-path: {state}, expected one of them")
    if config.wandb_file is not None and config.wandb_run_path is None:
        raise InputError("--wandb-file: needs --wandb-run-path")
    if config.motion is not None and config.dataset is not None:
        raise InputError("--motion and --dataset: both are given, expected one of them")
    values = {"--tolerance": config.tolerance, "--angle-tolerance": config.angle_tolerance, "--timeout": config.timeout}
    if config.fps is not None:
        values["--fps"] = config.fps
    for option, value in values.items():
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(f"{option}: is {value}, expected a finite number > 0")
    if config.name is not None and not re.fullmatch(r"[\w.-]+", config.name):
        raise InputError(f"--name: is '{config.name}', expected letters, digits, '.', '_' and '-'")


def _checkpoint_path(config: PrepareConfig, console: Console) -> Path:
    if config.wandb_run_path is None:
        assert config.policy is not None  # one of the two is given
        return Path(config.policy)
    from humanoid_sim.prepare.wandb_run import fetch_checkpoint  # noqa: PLC0415 - only for this option

    columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bars:
        tasks: dict[str, int] = {}

        def show(name: str, so_far: int, size: int) -> None:
            if name not in tasks:
                tasks[name] = bars.add_task(name, total=size or None)
            bars.update(bars.task_ids[tasks[name]], completed=so_far)

        path, notice = fetch_checkpoint(config.wandb_run_path, config.wandb_file, timeout=config.timeout, progress=show)
    if notice:
        console.print(notice, markup=False)
    console.print(f"checkpoint {path}", markup=False)
    return path


def _read(config: PrepareConfig, checkpoint: Checkpoint, robot: Robot, console: Console) -> SourceMotion:
    """The source, in the order of REFERENCE: a path, a dataset by id, the checkpoint's own dataset."""
    joints = robot.skeleton.joints
    roles = parse_roles(config.features)
    if config.motion is not None:
        path = Path(config.motion)
        reader = _READERS.get(path.suffix.lower())
        if path.is_dir():
            from humanoid_sim.prepare.lerobot_motion import read_local_dataset  # noqa: PLC0415 - brings PyTorch

            return read_local_dataset(path, config.episode, roles, joints)
        if not path.exists():
            raise InputError(f"--motion: '{path}' does not exist, expected an .npz or .csv file or a dataset's folder")
        if reader is None:
            raise InputError(f"--motion: '{path}' is no .npz or .csv file and no folder")
        return reader(config, path, robot)
    dataset = config.dataset or checkpoint.contract.dataset_repo_id
    if not dataset:
        raise InputError(f"--motion: is missing, and {checkpoint.source} names no dataset")
    if config.dataset is None:
        console.print(f"motion: the dataset {dataset} that the checkpoint names", markup=False)
    from humanoid_sim.prepare.lerobot_motion import read_hub_dataset  # noqa: PLC0415

    return read_hub_dataset(dataset, config.episode, roles, joints, config.timeout)


def _read_npz(config: PrepareConfig, path: Path, _: Robot) -> SourceMotion:
    from humanoid_sim.prepare.npz import read_npz  # noqa: PLC0415

    if config.fps is not None:
        raise InputError(f"--fps: is given, but {path} says its frame rate itself")
    return read_npz(path)


def _read_csv(config: PrepareConfig, path: Path, robot: Robot) -> SourceMotion:
    from humanoid_sim.prepare.csv_motion import read_csv  # noqa: PLC0415

    return read_csv(
        path,
        robot.skeleton.joints,
        config.fps,
        floating=robot.description.is_floating,
        quaternions=config.quaternions,
    )


_READERS: dict[str, Callable[[PrepareConfig, Path, Robot], SourceMotion]] = {".npz": _read_npz, ".csv": _read_csv}


def _make(
    config: PrepareConfig, checkpoint: Checkpoint, robot: Robot, source: SourceMotion
) -> tuple[Motion, MotionReport]:
    """Check, resample and convert."""
    contract = checkpoint.contract
    tolerance = Tolerance(config.tolerance, math.radians(config.angle_tolerance))
    conventions = choose_conventions(
        source,
        contract,
        robot.skeleton,
        joint_order=config.joint_order,
        body_order=config.body_order,
        quaternions=config.quaternions,
    )
    found = examine(source, conventions, contract, robot, tolerance)
    same_rate = has_rate(source.fps, contract.policy_dt)
    if not same_rate and not config.resample:
        raise InputError(
            f"{source.source}: has {source.fps:g} frames per second, the policy takes {1.0 / contract.policy_dt:g} "
            "steps; add --resample to interpolate"
        )
    named = found.motion if same_rate else resample(found.motion, contract.policy_dt)
    motion, origin = convert(source.source, named, contract, robot.skeleton, robot.verifier, robot.description.name)
    report = MotionReport(
        source=source.source,
        kind=source.kind,
        sha256=_digest(source.source),
        robot=robot.description.name,
        policy=checkpoint.source,
        source_fps=source.fps,
        source_frames=source.frame_count,
        policy_dt=contract.policy_dt,
        frames=len(motion.frames),
        resampled=not same_rate,
        layout=motion.layout,
        bodies_from=origin,
        conventions=conventions,
        method=found.method,
        tolerance=tolerance,
        bodies=found.bodies,
        rate=found.rate,
        beyond_limits=found.beyond_limits,
        notes=found.notes,
    )
    return motion, report


def _digest(source: str) -> str:
    path = Path(source)
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""


def _name(config: PrepareConfig, source: SourceMotion) -> str:
    """A file name from the source's: `waltz` for waltz.npz, `dances_3` for episode 3 of a dataset of dances."""
    if config.motion is not None and Path(config.motion).is_file():
        return Path(config.motion).stem
    stem = re.sub(r"[^\w-]+", "_", source.source.rpartition("/")[2])
    return stem.replace("_episode_", "_").strip("_") or "motion"
