"""`policy stamp`: a copy of a checkpoint that needs no other file."""

from __future__ import annotations

from rich.markup import escape

from humanoid_sim.policy.cli.options import Stamp
from humanoid_sim.policy.cli.show import make_console
from humanoid_sim.policy.stamp import stamp
from humanoid_sim.robots.description import load_robot

__all__ = ["stamp_copy"]


def stamp_copy(options: Stamp) -> int:
    """Write the copy, and say what its golden vectors are worth."""
    result = stamp(
        options.checkpoint,
        options.output,
        contract_file=options.contract,
        description=None if options.robot is None else load_robot(options.robot),
        trace=options.trace,
        motion=options.motion,
        overwrite=options.overwrite,
    )
    console = make_console()
    console.print(f"{escape(str(result.output))}: {result.size / 1e6:.2f} MB, contract inside", soft_wrap=True)
    console.print(f"golden vectors: {escape(result.samples.label)}", soft_wrap=True)
    if result.samples.origin == "own":
        console.print("  --trace FILE with the trainer's run makes vectors that show wrong wiring as well")
    for unseen in result.blind_spots:
        console.print(f"  not seen by them: {escape(unseen)}", soft_wrap=True)
    return 0
