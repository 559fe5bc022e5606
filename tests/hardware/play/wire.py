"""A listener on the wire: every frame of a bus with the time at which it came, and what each says."""

import threading
import time
from dataclasses import dataclass

import can

from humanoid_sim.hardware.bus.address import frame_of, open_bus, parse_address
from humanoid_sim.hardware.robstride.codec import decode_command
from humanoid_sim.hardware.robstride.messages import OperationControl, Stop
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.motors import motor_model
from humanoid_sim.session.realtime import punctual_threads

_QUIET = 0.2
"""s"""


@dataclass(frozen=True, slots=True)
class Heard:
    """A frame that a host sent to a motor."""

    time: float
    """s, this process's `time.monotonic`."""
    motor_id: int
    kind: str
    """`drive` with a stiffness, `damp` without, `zero` without any gain, `stop`, or `other`."""


class Listener:
    """Reads a bus on a thread of its own until it is closed."""

    def __init__(self, channel: str, robot: str) -> None:
        self._models = {
            joint.motor.can_id: motor_model(joint.motor.model)
            for joint in load_robot(robot).joints
            if joint.motor is not None
        }
        self.frames: list[Heard] = []
        self._read = 0.0
        self._stop = threading.Event()
        self._bus = open_bus(parse_address(channel))
        self._thread = threading.Thread(target=self._listen, name="listener")
        with punctual_threads(behind=10):  # a frame for which the socket has no room is lost
            self._thread.start()

    def __enter__(self) -> "Listener":
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self._bus.shutdown()

    def _listen(self) -> None:
        while not self._stop.is_set():
            message = self._bus.recv(0.05)
            if message is not None:
                # The kernel's stamp: what lay there while this thread was not running came when it came.
                self._read = time.monotonic()
                self._note(message, time.monotonic() - (time.time() - message.timestamp))

    def _note(self, message: can.Message, now: float) -> None:
        frame = frame_of(message)
        motor_id = frame.arbitration_id & 0xFF
        model = self._models.get(motor_id)
        if model is None:  # what a motor answers
            return
        said = decode_command(frame, motor_id, model)
        kind = "other"
        if isinstance(said, OperationControl):
            kind = "drive" if said.stiffness > 0.0 else "damp" if said.damping > 0.0 else "zero"
        elif isinstance(said, Stop):
            kind = "stop"
        self.frames.append(Heard(now, motor_id, kind))

    def settle(self) -> None:
        """Wait until all that was sent has been read: on a busy machine this thread is behind."""
        while self.frames and time.monotonic() - self._read < _QUIET:
            time.sleep(_QUIET)

    def after(self, moment: float, *kinds: str) -> list[Heard]:
        """The frames of these kinds since a moment; of all kinds if none is named."""
        return [frame for frame in self.frames if frame.time >= moment and (not kinds or frame.kind in kinds)]

    def table(self, moment: float) -> str:
        """What was sent since a moment: consecutive frames of a kind as one line, with ms of the first and the last."""
        lines, run = [], []
        for frame in [*self.after(moment), None]:
            if run and (frame is None or frame.kind != run[0].kind or frame.time - run[-1].time > 0.06):
                first, last = (1e3 * (run[at].time - moment) for at in (0, -1))
                lines.append(f"{run[0].kind:<6} {len(run):5d} frames  {first:8.1f} to {last:8.1f} ms")
                run = []
            if frame is not None:
                run.append(frame)
        return "\n".join(lines)
