"""A loop with a watchdog, in a process of its own: `watched_loop.py CHANNEL`."""

import sys
import time

import can

from humanoid_sim.hardware.can_bus import Frame, lock_channel, open_bus, parse_address
from humanoid_sim.hardware.sito import watchdog
from humanoid_sim.hardware.sito.watchdog import Watchdog, WatchedMotor

COMMAND, GAINS, DAMPING, RESET = 0x05061609, 0x05061645, 0x05061709, 0x05061600
PERIOD = 0.01
DAMPING_TIME = 0.4


def motor(channel: str) -> WatchedMotor:
    gains = Frame(GAINS, b"\0\0\0\0\x3f\x80\0\0")
    damping = (gains, gains, Frame(DAMPING, bytes(8)))
    return WatchedMotor("left_wrist_roll", parse_address(channel), damping, (Frame(RESET, b"U" * 8),))


def main(channel: str) -> None:
    watchdog.DAMPING_TIME = DAMPING_TIME
    with lock_channel(parse_address(channel)) as lock, open_bus(parse_address(channel)) as bus:
        dog = Watchdog([motor(channel)], [lock.fileno()])
        dog.enabled()
        print(dog.pid, flush=True)
        count, was_displaced = 0, False
        while True:
            if dog.poll():
                bus.send(can.Message(arbitration_id=COMMAND, data=count.to_bytes(8, "big")))
                dog.beat()
                count += 1
            elif not was_displaced:
                status = dog.status()
                print(f"displaced: {status.source} {status.level.name}", flush=True)
                was_displaced = True
            time.sleep(PERIOD)


if __name__ == "__main__":
    main(sys.argv[1])
