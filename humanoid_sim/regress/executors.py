"""Executors of batches of episodes: this process, or a Ray cluster (extra `cluster`); the results are the same.

A task of a cluster is some seeds of one policy and case. What it needs travels with it: model, contract, motion, suite
and the robot's description. The package must be installed on every node, and a robot of one's own must be in the same
place.
"""

from __future__ import annotations

import math
import os
import socket
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import msgspec

from humanoid_sim.errors import InputError, MissingPackageError
from humanoid_sim.policy.checkpoint import Checkpoint
from humanoid_sim.policy.contract_json import decode, encode
from humanoid_sim.policy.motion import motion_bytes, parse_motion
from humanoid_sim.policy.onnx_policy import OnnxPolicy, external_file
from humanoid_sim.regress.batched_policy import BatchedPolicy
from humanoid_sim.regress.episodes import run_episodes
from humanoid_sim.regress.preparation import PreparedCase, prepare_case
from humanoid_sim.regress.results import Episode
from humanoid_sim.regress.suite import Disturbance, Suite
from humanoid_sim.robots.schema import RobotDescription

Advance = Callable[[int], None]
"""Told how many episodes have just ended."""

LOCAL = "local"
"""The address that stands for a cluster on this machine, for as long as the program runs."""
_PATIENCE = 5.0
"""s that a cluster's head has to answer."""
_TASKS_PER_PROCESSOR = 2
"""So that a processor that is done early has something left to do."""


Executor = Callable[[Sequence[PreparedCase], Sequence[int], Disturbance, Advance], list[Episode]]
"""Function that runs every case with every seed: case by case and, within one, seed by seed. Whoever it is, the
episodes are the same, bit for bit on machines of a kind."""


def run_locally(
    cases: Sequence[PreparedCase],
    seeds: Sequence[int],
    disturbance: Disturbance,
    advance: Advance,
    *,
    threads: int | None = None,
) -> list[Episode]:
    """Run case after case in this process, each on so many threads; None for one per processor. See `Executor`."""
    episodes: list[Episode] = []
    for case in cases:
        episodes += run_episodes(case, seeds, disturbance, threads=threads)
        advance(len(seeds))
    return episodes


@dataclass(frozen=True, slots=True)
class Parcel:
    """A prepared case as bytes and texts."""

    suite: bytes
    case: str
    robot: str
    folder: str
    source: str
    sha256: str
    contract: str
    model: bytes
    external: bytes | None
    """Tensors beside the model."""
    motion: bytes | None


def pack_case(case: PreparedCase) -> Parcel:
    """Pack everything that another machine needs to prepare the same case."""
    checkpoint = case.checkpoint
    path = Path(checkpoint.source)
    external = external_file(path)
    return Parcel(
        suite=msgspec.json.encode(case.suite),
        case=case.case.name,
        robot=case.description.to_json(),
        folder=case.description.folder,
        source=checkpoint.source,
        sha256=checkpoint.sha256,
        contract=encode(checkpoint.contract),
        model=path.read_bytes(),
        external=external.read_bytes() if external.is_file() else None,
        motion=None if case.motion is None else motion_bytes(case.motion),
    )


@lru_cache(maxsize=16)
def unpack_case(parcel: Parcel) -> PreparedCase:
    """Return the case that was packed. The same parcel gives the same object."""
    suite = msgspec.json.decode(parcel.suite, type=Suite)
    contract = decode(parcel.contract, parcel.source)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / Path(parcel.source).name
        path.write_bytes(parcel.model)
        if parcel.external is not None:
            external_file(path).write_bytes(parcel.external)
        policy = OnnxPolicy(path, contract.tensors)
        batched = BatchedPolicy(policy)
    checkpoint = Checkpoint(contract, policy, parcel.source, parcel.sha256, policy.observation_width)
    description = RobotDescription.from_json(parcel.robot, parcel.folder)
    motion = None if parcel.motion is None else parse_motion(parcel.motion, "motion")
    case = next(case for case in suite.cases if case.name == parcel.case)
    return prepare_case(suite, case, checkpoint, batched, description, motion)


def _run_task(parcel: Parcel, seeds: tuple[int, ...], disturbance: Disturbance) -> list[Episode]:
    """Return what a worker does."""
    return run_episodes(unpack_case(parcel), seeds, disturbance, threads=1)


def _check_reachable(address: str) -> None:
    """Check that somebody listens at an address: Ray itself would try for minutes, and complain all the while.

    Raises `InputError` if nobody does.
    """
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not host or not port.isdigit():
        return  # `auto`, `local`, or a name that Ray will judge
    try:
        socket.create_connection((host, int(port)), timeout=_PATIENCE).close()
    except (OSError, OverflowError) as error:
        raise InputError(f"--ray: is '{address}', and nobody answers there: {error}") from None


class RayExecutor:
    """Runs episodes on a Ray cluster, one task per processor at a time."""

    def __init__(self, address: str, processors: int | None = None) -> None:
        """Connect. Raises `InputError` if Ray is missing, or there is no such cluster.

        Args:
            address: of the cluster's head, `auto` for the one that this machine belongs to, or `local`.
            processors: of a cluster that is started here; None for all of this machine.
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

    def run(
        self, cases: Sequence[PreparedCase], seeds: Sequence[int], disturbance: Disturbance, advance: Advance
    ) -> list[Episode]:
        """See `Executor`."""
        ray = self._ray
        processors = max(int(ray.cluster_resources().get("CPU", 1)), 1)
        size = max(math.ceil(len(cases) * len(seeds) / (_TASKS_PER_PROCESSOR * processors)), 1)
        task = ray.remote(num_cpus=1)(_run_task)
        tasks = []
        for case in cases:
            parcel = ray.put(pack_case(case))
            chunks = (tuple(seeds[begin : begin + size]) for begin in range(0, len(seeds), size))
            tasks += [task.remote(parcel, chunk, disturbance) for chunk in chunks]
        pending, results = list(tasks), dict[Any, list[Episode]]()
        while pending:
            (done,), pending = ray.wait(pending, num_returns=1)
            results[done] = self._result(done)
            advance(len(results[done]))
        return [episode for reference in tasks for episode in results[reference]]

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
