"""Executors of episodes: this process, or a Ray cluster (extra `cluster`); the results are the same.

On a cluster the package, the checkpoint and the robot's files must be at the same paths on every machine.
"""

from __future__ import annotations

import math
import os
import pickle
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from humanoid_sim.errors import InputError, needing
from humanoid_sim.regress.episodes import run_episodes
from humanoid_sim.regress.preparation import TestedPolicy, prepare_policy
from humanoid_sim.regress.results import Episode

Advance = Callable[[int], None]
"""Called with how many episodes have just ended."""
Executor = Callable[[TestedPolicy, Advance], list[Episode]]
"""Function that runs every case with every seed: case by case and, within one, seed by seed. Each gives the same
episodes, bit for bit on machines of a kind."""

LOCAL = "local"
"""Address of a cluster on this machine, for as long as the program runs."""
_TIMEOUT = 5.0
"""s that a cluster's head has to answer; Ray itself would try for minutes."""
_TASKS_PER_PROCESSOR = 2
"""So that a processor that is done early has something left to do."""


def run_locally(policy: TestedPolicy, advance: Advance, *, threads: int | None = None) -> list[Episode]:
    """Run case after case in this process, each on so many threads; None for one per processor."""
    episodes: list[Episode] = []
    suite = policy.prepared.suite
    for case in policy.cases:
        episodes += run_episodes(case, suite.seed_numbers, suite.disturbance, threads=threads)
        advance(suite.seeds)
    return episodes


@contextmanager
def ray_executor(address: str, processors: int | None = None) -> Iterator[Executor]:
    """Connect to a Ray cluster for a while. Raises `InputError` if Ray is missing, or there is no such cluster.

    Args:
        address: of the cluster's head, `auto` for the one that this machine belongs to, or `local`.
        processors: of a cluster that is started here; None for all of this machine.
    """
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if host and port.isdigit():
        try:
            socket.create_connection((host, int(port)), timeout=_TIMEOUT).close()
        except (OSError, OverflowError) as error:
            raise InputError(f"--ray: is '{address}', and nobody answers there: {error}") from None
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    with needing("ray", "cluster", "--ray"):
        import ray  # noqa: PLC0415 - an extra, and slow to import
    local = {"num_cpus": processors, "include_dashboard": False} if address == LOCAL else {}
    try:
        ray.init(address, log_to_driver=False, logging_level="error", **local)
    except (ConnectionError, ValueError, RuntimeError) as error:
        raise InputError(f"--ray: is '{address}', and no cluster answers there: {error}") from None
    try:
        yield partial(_run_on_ray, ray)
    finally:
        ray.shutdown()


def _run_on_ray(ray: Any, policy: TestedPolicy, advance: Advance) -> list[Episode]:
    """See `Executor`; a task is some seeds of one case."""
    seeds = policy.prepared.suite.seed_numbers
    parcel = ray.put(parcel_of(policy))
    processors = max(int(ray.cluster_resources().get("CPU", 1)), 1)
    size = max(math.ceil(len(policy.cases) * len(seeds) / (_TASKS_PER_PROCESSOR * processors)), 1)
    remote = ray.remote(num_cpus=1)(run_task)
    chunks = [(case, seeds[at : at + size]) for case in range(len(policy.cases)) for at in range(0, len(seeds), size)]
    episodes: list[Episode] = []
    for task in [remote.remote(parcel, *chunk) for chunk in chunks]:
        try:
            episodes += (done := ray.get(task))
        except ray.exceptions.RayError as error:
            raise InputError(f"--ray: the cluster lost episodes: {error}") from None
        advance(len(done))
    return episodes


def parcel_of(policy: TestedPolicy) -> bytes:
    """Return what a worker prepares the policy from."""
    file, contract_file = Path(policy.checkpoint.source), policy.checkpoint.contract_file
    return pickle.dumps((policy.prepared, file.resolve(), contract_file and contract_file.resolve()))


def run_task(parcel: bytes, case: int, seeds: Sequence[int]) -> list[Episode]:
    """Run some seeds of one case, as a worker does."""
    policy = _prepared(parcel)
    return run_episodes(policy.cases[case], seeds, policy.prepared.suite.disturbance, threads=1)


@lru_cache(maxsize=4)
def _prepared(parcel: bytes) -> TestedPolicy:
    return prepare_policy(*pickle.loads(parcel))
