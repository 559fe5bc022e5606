"""A program with a loop that a guardian watches: `guarded_loop.py CHANNEL`. What it says, the tests wait for."""

import sys
import time

import can

from humanoid_sim.hardware.bus.address import open_bus as open_python_can
from humanoid_sim.hardware.bus.address import parse_address
from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.bus.open_channels import ChannelLock
from humanoid_sim.hardware.guardian.guardian import Guardian
from humanoid_sim.hardware.guardian.protocol import GuardedMotor, GuardianPlan

COMMAND, GAINS, DAMPING, RESET = 0x05061609, 0x05061645, 0x05061709, 0x05061600
PERIOD = 0.01
DAMPING_TIME = 0.4


def plan(channel: str) -> GuardianPlan:
    gains = Frame(GAINS, b"\0\0\0\0\x3f\x80\0\0")
    motor = GuardedMotor(
        "left_wrist_roll", parse_address(channel), (gains, gains, Frame(DAMPING, bytes(8))), (Frame(RESET, b"U" * 8),)
    )
    return GuardianPlan((motor,), damping_time=DAMPING_TIME, period=0.02, reset_rounds=3)


def main(channel: str) -> None:
    with ChannelLock(parse_address(channel)) as lock:
        guardian = Guardian(plan(channel), [lock.descriptor])
        bus = guardian.opener(open_python_can)(parse_address(channel))
        try:
            guardian.standby()
            print(f"guardian {guardian.pid}", flush=True)
            count = 0
            was_refused = False
            while True:
                guardian.beat()
                status = guardian.status()
                try:
                    bus.send(can.Message(arbitration_id=COMMAND, data=count.to_bytes(8, "big")))
                except can.CanOperationError as error:
                    assert status is not None
                    if not was_refused:
                        print(f"refused: {error}; {status.source} {status.level.name}", flush=True)
                    was_refused = True
                    if "release" in sys.argv:
                        break
                count += 1
                time.sleep(PERIOD)
            guardian.release(confirmed=False)
            print(f"drives: {guardian.drives}", flush=True)
            bus.send(can.Message(arbitration_id=RESET, data=b"loop"))
        finally:
            bus.shutdown()
            guardian.release(confirmed=True)


if __name__ == "__main__":
    main(sys.argv[1])
