"""Driver for MicroStrain IMUs on a serial port (3DM-CV7, -GV7, -GQ7 and what else speaks their protocol).

Chosen because its protocol is published whole, without a registration, and with example packets to test against;
because one checksummed packet holds attitude, rate and acceleration of one instant; and because legged robots carry it.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from time import monotonic

import numpy as np
import serial

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.imu.interface import ImuReading, silent, upright_at_rest
from humanoid_sim.hardware.imu.microstrain_setup import configure
from humanoid_sim.hardware.imu.mip import PacketReader
from humanoid_sim.hardware.imu.sensor_data import LABEL_UP, SENSOR_DATA, reading_of

__all__ = ["MicrostrainImu"]

_POLL = 0.02
"""s that the listening thread waits for bytes before it looks whether to stop."""
_FIRST_SAMPLE = 1.0
"""s that `open` waits for a first sample."""


class MicrostrainImu:
    """An `Imu`. A thread of its own listens; `read` only looks at what it heard last."""

    def __init__(
        self,
        port: str,
        *,
        baudrate: int = 115200,
        rate: float = 100.0,
        mounting: Sequence[float] = LABEL_UP,
        timeout: float = 0.1,
        clock: Callable[[], float] = monotonic,
    ) -> None:
        """Prepare.

        Args:
            port: such as `/dev/ttyACM0`.
            baudrate: bit/s; devices on USB ignore it. One packet is 52 bytes: 115200 carries 200 of them a second.
            rate: Hz, of samples.
            mounting: w x y z, the device's axes in the robot's IMU frame.
            timeout: s without a sample after which the status is FAULT.
            clock: the robot's clock, s.
        """
        self._port = port
        self._baudrate = baudrate
        self._rate = rate
        self._mounting = np.array(mounting, dtype=np.float64)
        self._timeout = timeout
        self._clock = clock
        self._serial: serial.Serial | None = None
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()
        self._heard = threading.Event()
        self._latest: tuple[float, ImuReading] | None = None
        self._problem = ""
        self.reader = PacketReader()
        """Counts what was damaged on the way."""
        self.samples = 0
        """Samples heard since `open`."""
        self.refused = 0
        """Packets of measurements that lacked one, or held one that is none."""

    def open(self) -> None:
        """Configure the device, listen, and wait for a first sample.

        Raises:
            RobotError: the port cannot be opened, or nothing that is an IMU answers on it.
        """
        self.close()
        try:
            self._serial = serial.Serial(self._port, self._baudrate, timeout=_POLL, write_timeout=1.0, exclusive=True)
        except (serial.SerialException, OSError, ValueError) as error:
            raise RobotError(f"{self._port}: the IMU's port cannot be opened: {error}") from None
        try:
            configure(self._serial, self._port, self._rate)
        except (serial.SerialException, OSError) as error:
            self.close()
            raise RobotError(f"{self._port}: the IMU cannot be configured: {error}") from None
        except RobotError:
            self.close()
            raise
        self._stop.clear()
        self._heard.clear()
        self._latest, self._problem = None, ""
        self.reader, self.samples, self.refused = PacketReader(), 0, 0
        self._thread = threading.Thread(target=self._listen, args=(self._serial,), name="imu", daemon=True)
        self._thread.start()
        if not self._heard.wait(_FIRST_SAMPLE):
            problem = self._problem or f"acknowledges but sends no sample within {_FIRST_SAMPLE:g} s"
            self.close()
            raise RobotError(f"{self._port}: the IMU {problem}")

    def read(self, time: float) -> ImuReading:
        """The latest reading; FAULT once it is older than the timeout."""
        latest = self._latest
        if latest is None:
            return upright_at_rest(silent(f"{self._port}: nothing heard yet"))
        heard, reading = latest
        if time - heard <= self._timeout:
            return reading
        problem = f"the IMU {self._problem}" if self._problem else f"the IMU is silent for {time - heard:.2f} s"
        return ImuReading(
            reading.quaternion,
            reading.angular_velocity,
            reading.linear_acceleration,
            silent(f"{self._port}: {problem}"),
        )

    def close(self) -> None:
        """Stop listening and release the port. May be called twice."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        if self._serial is not None:
            self._serial.close()
            self._serial = None

    def _listen(self, port: serial.Serial) -> None:
        while not self._stop.is_set():
            try:
                data = port.read(max(port.in_waiting, 1))
            except (serial.SerialException, OSError) as error:  # unplugged
                self._problem = f"cannot be read any more: {error}"
                return
            for packet in self.reader.feed(data):
                if packet.descriptor_set != SENSOR_DATA:
                    continue
                reading = reading_of(packet, self._mounting)
                if reading is None:
                    self.refused += 1
                else:
                    self._latest = self._clock(), reading
                    self.samples += 1
                    self._heard.set()
