"""Executors of episodes: this process, or a Ray cluster (extra `cluster`); the results are the same.

On a cluster the package, the checkpoint and the robot's files must be at the same paths on every machine.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from msgspec.structs import replace as changed

from humanoid_sim.errors import InputError, blaming, needing
from humanoid_sim.regress.episodes import run_episodes
from humanoid_sim.regress.preparation import PreparedSuite, TestedPolicy, prepare_policy
from humanoid_sim.regress.results import Episode

Advance = Callable[[int], object]  # of so many episodes that have just ended
Executor = Callable[[TestedPolicy, Advance], list[Episode]]  # case by case, seed by seed
_CHUNK = 8  # seeds of one task of a cluster


def run_locally(policy: TestedPolicy, advance: Advance, *, threads: int | None = None) -> list[Episode]:
    """Run case after case in this process, each on so many threads; None for one per processor."""
    episodes: list[Episode] = []
    for case in policy.cases:
        episodes += run_episodes(case, case.suite.seed_numbers, threads=threads)
        advance(case.suite.seeds)
    return episodes


@contextmanager
def ray_executor(address: str, processors: int | None = None) -> Iterator[Executor]:
    """Connect to a Ray cluster: its address, or `local` to start one here with so many processors, None for all.

    Raises `InputError` if there is no such cluster, and `MissingPackageError` without Ray.
    """
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if host and port.isdecimal():  # Ray itself would try for minutes
        with blaming(f"--ray: is '{address}', and nobody answers there", (OSError, OverflowError)):
            socket.create_connection((host, int(port)), timeout=5.0).close()
    with needing("ray", "cluster", "--ray"):
        import ray  # noqa: PLC0415 - an extra, and slow to import
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    local = {"num_cpus": processors, "include_dashboard": False} if address == "local" else {}
    try:
        ray.init(address, log_to_driver=False, logging_level="error", **local)
    except (ConnectionError, ValueError, RuntimeError) as error:
        raise InputError(f"--ray: is '{address}', and no cluster answers there: {error}") from None
    try:
        yield partial(_run_on_ray, ray)
    finally:
        ray.shutdown()


def _run_on_ray(ray: Any, policy: TestedPolicy, advance: Advance) -> list[Episode]:
    seeds, task = policy.prepared.suite.seed_numbers, ray.remote(num_cpus=1)(run_seeds)
    file, contract = Path(policy.checkpoint.source).resolve(), policy.checkpoint.contract_file
    tasks = []
    for case in policy.prepared.suite.cases:
        prepared = replace(policy.prepared, suite=changed(policy.prepared.suite, cases=(case,)))
        parcel = ray.put((prepared, file, contract and contract.resolve()))
        tasks += [task.remote(parcel, seeds[at : at + _CHUNK]) for at in range(0, len(seeds), _CHUNK)]
    episodes: list[Episode] = []
    for running in tasks:
        done = ray.get(running)
        episodes += done
        advance(len(done))
    return episodes


def run_seeds(parcel: tuple[PreparedSuite, Path, Path | None], seeds: Sequence[int]) -> list[Episode]:
    """Run some seeds of a suite's only case, as a worker of a cluster does."""
    (case,) = prepare_policy(*parcel).cases
    return run_episodes(case, seeds, threads=1)
