"""A program that drives emulated motors in another process until it is killed: `campaign_host.py CHANNEL MODE`."""

import sys

from drive_rig import driven

from humanoid_sim.messages import Mode
from humanoid_sim.session.realtime import real_time

if __name__ == "__main__":
    channel, mode = sys.argv[1:]
    with real_time(), driven(channel) as drive:
        drive.reach(Mode[mode])
        print("there", flush=True)
        drive.run(60.0)
