"""Examine the plants of published policies, and their right contracts: `examine_plants.py [--trace] POLICY ...`."""

import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console

sys.path += [str(Path(__file__).parent), str(Path(__file__).parents[1] / "policy")]
from plants import alike, plants_of
from published_policies import published, trace_of

from humanoid_sim.doctor.edits import isaac_order
from humanoid_sim.doctor.samples import Samples
from humanoid_sim.doctor.search import search_episodes, search_trace


def examine(policy: str, *, with_trace: bool) -> None:
    """Print a row for each plant, and how many were named first."""
    right = published(policy, Path(tempfile.mkdtemp()))
    plants = plants_of(policy, right.description.joint_names, isaac_order(right.description))
    named, seconds = 0, []
    for name, plant in {"the right contract": lambda contract: contract, **plants}.items():
        wrong = plant(right.contract)
        subject = replace(right, contract=wrong, motion=right.motion_under(wrong))
        start = time.perf_counter()
        if with_trace:
            result = search_trace(subject, Samples(subject, trace_of(policy)))
        else:
            result = search_episodes(subject, Console(quiet=True))
        seconds.append(time.perf_counter() - start)
        found = result.finding
        is_right = found is None if name not in plants else found is not None and alike(found.contract, right.contract)
        is_right |= name == "default pose zero" and found is not None and found.family == "default pose"
        named += is_right and name in plants
        print(f"{policy} | {name} | {'yes' if is_right else 'NO'} | {result.verdict} | {seconds[-1]:.0f} s", flush=True)
    median = float(np.median(seconds))
    print(f"{policy} | {named} of {len(plants)} | median {median:.0f} s, largest {max(seconds):.0f} s", flush=True)


if __name__ == "__main__":
    for word in sys.argv[1:]:
        if not word.startswith("--"):
            examine(word, with_trace="--trace" in sys.argv)
