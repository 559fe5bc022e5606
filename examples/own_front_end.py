"""A front end of your own: prints once a second which joint works hardest, on any running session.

    python -m humanoid_sim.play --manual &
    python examples/own_front_end.py

It needs `humanoid_sim/client.py`, NumPy and nothing else, so it runs in any Python, a ROS environment's too. Kill it at
any time: the control loop does not notice. `docs/front-ends.md` says what else a session tells and takes.
"""

from __future__ import annotations

import sys

import numpy as np

from humanoid_sim.client import Feed, find_session


def main() -> int:
    """Watch until the session ends."""
    with Feed(find_session()) as feed:
        number, shown = 0, -1.0
        while feed.is_running():
            sample = feed.wait(number, 0.5)
            if sample is None:
                continue
            number = sample.number
            tick = feed.decode(sample)
            if tick["time"] < shown + 1.0:
                continue
            shown = tick["time"]
            effort = np.abs(tick["joint_effort"])
            joint = int(np.nanargmax(effort))
            print(f"{shown:7.2f} s  {feed.joint_names[joint]}: {effort[joint]:.2f} N·m", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
