"""One run of `prepare`, from options to a motion file."""

from __future__ import annotations

import re
from pathlib import Path

from humanoid_sim.assets import policy_path
from humanoid_sim.errors import InputError, blaming, require_known
from humanoid_sim.files import whole_file
from humanoid_sim.policy.checkpoint import Checkpoint, load_checkpoint
from humanoid_sim.policy.motion import Motion, motion_bytes
from humanoid_sim.policy.song import load_song, song_motion
from humanoid_sim.prepare import PrepareOptions, sources
from humanoid_sim.prepare.check import check
from humanoid_sim.prepare.convert import Skeleton, at_rate, convert, interpret
from humanoid_sim.prepare.wandb_run import fetch_checkpoint
from humanoid_sim.robots.description import RobotDescription, load_robot

_HIGHEST_RATE = 1000.0  # Hz
_SONG_RATE = 50.0  # Hz of the goals where neither a policy nor the user gives a rate


def prepare(options: PrepareOptions) -> int:
    """Run, and return the exit status. Raises `InputError` before a motion file is written."""
    if options.motion is not None and options.song is not None:
        raise InputError("--motion and --song: both are given, expected one of them")
    if options.fps is not None and not 0.0 < options.fps <= _HIGHEST_RATE:
        raise InputError(f"--fps: is {options.fps:g}, expected a number > 0, of at most {_HIGHEST_RATE:g}")
    folder = Path(options.output)
    robot = load_robot(options.robot)
    checkpoint = _checkpoint(options, folder, robot)
    if options.song is not None:
        if options.fps is not None and checkpoint is not None:
            raise InputError("--fps: is given, but the policy's rate counts")
        policy_dt = 1.0 / (options.fps or _SONG_RATE) if checkpoint is None else checkpoint.contract.policy_dt
        motion, lines, name = _song(options.song, policy_dt, robot)
    elif checkpoint is None:
        raise InputError("--policy: is missing; it, --wandb-run-path or --song is needed")
    elif checkpoint.motion is not None and options.motion is None:
        print(f"{checkpoint.source} carries its motion itself: there is nothing else to prepare")
        return 0
    else:
        motion, lines, name = _motion(options, checkpoint, robot)
    if checkpoint is not None:
        checkpoint.with_motion(motion)  # the same check as `play` makes: terms, widths, bodies and rate
    stem = re.sub(r"[^\w.-]+", "_", options.name or name)
    target = folder / f"{stem}.mcap"
    if target.exists() and not options.overwrite:
        raise InputError(f"--output: '{target}' exists; choose another --name, or add --overwrite")
    with blaming(f"--output: '{folder}' cannot be written", OSError):
        folder.mkdir(parents=True, exist_ok=True)
    with whole_file(target) as file:
        file.write(motion_bytes(motion))
    rate = f"{len(motion.frames)} frames at {1.0 / motion.policy_dt:g} Hz, {motion.duration:.2f} s"
    print("\n".join((*lines, f"wrote {target}: {rate}")))
    return 0


def _checkpoint(options: PrepareOptions, folder: Path, robot: RobotDescription) -> Checkpoint | None:
    if options.policy is not None and options.wandb_run_path is not None:
        raise InputError("--policy and --wandb-run-path: both are given, expected one of them")
    if options.wandb_run_path is not None:
        path = fetch_checkpoint(options.wandb_run_path, options.wandb_file, folder)
        print(f"checkpoint {path}")
    elif options.policy is not None:
        path = policy_path(options.policy)
    else:
        return None
    contract_file = None if options.contract is None else Path(options.contract)
    checkpoint = load_checkpoint(path, contract_file, robot.joint_names)
    require_known("joint", checkpoint.contract.joint_names, robot.joint_names, f"{path} on robot '{robot.name}': ")
    task = checkpoint.contract.task_type
    wanted = "tracking" if options.song is None else "piano"
    if task != wanted:
        raise InputError(f"{path}: is a policy of task_type {task}, expected {wanted} for a motion to be prepared")
    return checkpoint


def _song(name: str, policy_dt: float, robot: RobotDescription) -> tuple[Motion, list[str], str]:
    """Return the goals of a song, a row every `policy_dt` s, what to print of it, and its name."""
    song = load_song(name, robot)
    lines = [f"{len(song.notes)} of {len(song.notes) + len(song.left_out)} notes"]
    if song.left_out:
        lines.append(f"left out, beyond reach or too many at a time: {song.names_left_out}")
    return song_motion(song, policy_dt, robot), lines, Path(name).stem


def _motion(options: PrepareOptions, checkpoint: Checkpoint, robot: RobotDescription) -> tuple[Motion, list[str], str]:
    contract = checkpoint.contract
    skeleton = Skeleton(robot, contract)
    given = options.motion or contract.dataset_repo_id
    if not given:
        raise InputError("--motion: is missing, and the checkpoint names no dataset")
    path = Path(given)
    source = _read(options, path, skeleton.joints)
    motion, assumed = interpret(source, skeleton, options)
    summary = f"{source.source}: {len(source.times)} frames at {source.rate:.4g} per second"
    lines = [summary, *check(motion, skeleton)]
    if assumed:
        lines.append(f"assumed, and confirmed by the bodies: {', '.join(assumed)}")
    name = path.stem if source.source == str(path) else f"{path.name}_{options.episode or 0}"
    return convert(at_rate(motion, contract.policy_dt, resample=options.resample), contract, skeleton), lines, name


def _read(options: PrepareOptions, path: Path, joints: tuple[str, ...]) -> sources.SourceMotion:
    suffix = path.suffix.lower() if path.suffix.lower() in (".csv", ".npz", ".mcap") else "dataset"
    for name, kind in (("fps", ".csv"), ("topic", ".mcap"), ("episode", "dataset")):
        if getattr(options, name) is not None and suffix != kind:
            raise InputError(f"--{name}: is given, but {path} is no {kind}")
    if suffix == ".csv":
        return sources.read_csv(path, joints, options.fps)
    if suffix == ".npz":
        return sources.read_npz(path)
    if suffix == ".mcap":
        return sources.read_joint_states(path, options.topic, joints)
    return sources.read_dataset(sources.dataset_folder(str(path)), options.episode, joints)
