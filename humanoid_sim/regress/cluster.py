"""Share episodes out over a Ray cluster (extra `cluster`); the results are those of one machine.

Each task is some seeds of one policy and case. What it needs travels with it: model, contract, motion, suite and the
robot's description. The package must be installed on every node, and a robot of one's own must be in the same place.
"""

from __future__ import annotations

import math
import os
import socket
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import msgspec

from humanoid_sim.errors import InputError, MissingPackageError
from humanoid_sim.policy.checkpoint import Checkpoint
from humanoid_sim.policy.contract_json import decode, encode
from humanoid_sim.policy.motion import motion_bytes, parse_motion
from humanoid_sim.policy.onnx_policy import OnnxPolicy
from humanoid_sim.regress.arena import Arena, make_arena
from humanoid_sim.regress.batched_policy import BatchedPolicy
from humanoid_sim.regress.episodes import Disturbance, run_episodes
from humanoid_sim.regress.jobs import Job, Progress
from humanoid_sim.regress.results import Episode
from humanoid_sim.regress.subject import Subject
from humanoid_sim.regress.suite import Suite
from humanoid_sim.robots.schema import RobotDescription

__all__ = ["LOCAL", "Parcel", "RayExecutor", "pack_arena", "unpack_arena"]

LOCAL = "local"
"""The address that stands for a cluster on this machine, for as long as the program runs."""
_PATIENCE = 5.0
"""s that a cluster's head has to answer."""
_TASKS_PER_PROCESSOR = 2
"""So that a processor that is done early has something left to do."""


@dataclass(frozen=True, slots=True)
class Parcel:
    """An arena as bytes and texts."""

    suite: bytes
    case: str
    robot: str
    folder: str
    name: str
    source: str
    sha256: str
    contract: str
    model: bytes
    external: bytes | None
    """Tensors beside the model."""
    motion: bytes | None


def pack_arena(suite: Suite, arena: Arena) -> Parcel:
    """Everything that another machine needs to make the same arena."""
    subject, description = arena.subject, arena.subject.description
    path = Path(subject.checkpoint.source)
    external = _external(path)
    return Parcel(
        suite=msgspec.json.encode(suite),
        case=arena.case.name,
        robot=description.to_json(),
        folder=description.folder,
        name=subject.name,
        source=subject.checkpoint.source,
        sha256=subject.checkpoint.sha256,
        contract=encode(subject.checkpoint.contract),
        model=path.read_bytes(),
        external=external.read_bytes() if external.is_file() else None,
        motion=None if arena.motion is None else motion_bytes(arena.motion),
    )


@lru_cache(maxsize=16)
def unpack_arena(parcel: Parcel) -> tuple[Suite, Arena]:
    """The arena that was packed, and its suite. The same parcel gives the same object."""
    suite = msgspec.json.decode(parcel.suite, type=Suite)
    contract = decode(parcel.contract, parcel.source)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / Path(parcel.source).name
        path.write_bytes(parcel.model)
        if parcel.external is not None:
            _external(path).write_bytes(parcel.external)
        policy = OnnxPolicy(path, contract.tensors)
        batched = BatchedPolicy(policy)
    checkpoint = Checkpoint(contract, policy, parcel.source, parcel.sha256, policy.observation_width)
    description = RobotDescription.from_json(parcel.robot, parcel.folder)
    motion = None if parcel.motion is None else parse_motion(parcel.motion, "motion")
    case = next(case for case in suite.cases if case.name == parcel.case)
    return suite, make_arena(suite, Subject(parcel.name, checkpoint, batched, description), case, motion)


def _external(path: Path) -> Path:
    return path.with_name(path.name + ".data")


def _run_task(parcel: Parcel, seeds: tuple[int, ...], disturbance: Disturbance) -> list[Episode]:
    """What a worker does."""
    suite, arena = unpack_arena(parcel)
    return run_episodes(suite, arena, seeds, disturbance, threads=1)


def _check_reachable(address: str) -> None:
    """Whether somebody listens at an address: Ray itself would try for minutes, and complain all the while.

    Raises:
        InputError: nobody does.
    """
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not host or not port.isdigit():
        return  # `auto`, `local`, or a name that Ray will judge
    try:
        socket.create_connection((host, int(port)), timeout=_PATIENCE).close()
    except (OSError, OverflowError) as error:
        raise InputError(f"--ray: is '{address}', and nobody answers there: {error}") from None


class RayExecutor:
    """Runs jobs on a Ray cluster, one task per processor at a time."""

    def __init__(self, address: str, processors: int | None = None) -> None:
        """Connect.

        Args:
            address: of the cluster's head, `auto` for the one that this machine belongs to, or `local`.
            processors: of a cluster that is started here; None for all of this machine.

        Raises:
            InputError: Ray is missing, or there is no such cluster.
        """
        _check_reachable(address)
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        try:
            import ray  # noqa: PLC0415 - an extra, and slow to import
        except ModuleNotFoundError as error:
            if error.name != "ray":
                raise
            raise MissingPackageError("ray", "cluster", "--ray") from None
        self._ray: Any = ray
        options: dict[str, Any] = {"address": address}
        if address == LOCAL:
            options |= {"num_cpus": processors, "include_dashboard": False}
        try:
            ray.init(**options, log_to_driver=False, logging_level="error", ignore_reinit_error=False)
        except (ConnectionError, ValueError, RuntimeError) as error:
            reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
            raise InputError(f"--ray: is '{address}', and no cluster answers there: {reason}") from None

    def run(self, suite: Suite, jobs: Sequence[Job], progress: Progress) -> list[list[Episode]]:
        """See `humanoid_sim.regress.jobs.Executor.run`."""
        ray = self._ray
        processors = max(int(ray.cluster_resources().get("CPU", 1)), 1)
        total = sum(len(job.seeds) for job in jobs)
        size = max(math.ceil(total / (_TASKS_PER_PROCESSOR * processors)), 1)
        task = ray.remote(num_cpus=1)(_run_task)
        pending: dict[Any, tuple[int, int]] = {}
        parts: list[dict[int, list[Episode]]] = [{} for _ in jobs]
        for i, job in enumerate(jobs):
            parcel = ray.put(pack_arena(suite, job.arena))
            for begin in range(0, len(job.seeds), size):
                reference = task.remote(parcel, job.seeds[begin : begin + size], job.disturbance)
                pending[reference] = (i, begin)
        while pending:
            (done,), _ = ray.wait(list(pending), num_returns=1)
            i, begin = pending.pop(done)
            parts[i][begin] = self._result(done)
            progress(len(parts[i][begin]))
        return [[episode for begin in sorted(part) for episode in part[begin]] for part in parts]

    def _result(self, reference: Any) -> list[Episode]:
        ray = self._ray
        try:
            episodes: list[Episode] = ray.get(reference)
        except ray.exceptions.RayTaskError as error:
            cause = error.cause
            if isinstance(cause, InputError):
                raise InputError(f"on the cluster: {cause}") from None
            raise
        except ray.exceptions.RayError as error:
            raise InputError(f"--ray: the cluster lost an episode: {str(error).strip().splitlines()[0]}") from None
        return episodes

    def close(self) -> None:
        """Leave the cluster; one that was started here ends."""
        self._ray.shutdown()
