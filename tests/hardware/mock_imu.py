"""A MicroStrain IMU behind a pseudo terminal: answers commands and streams the measurements that a test sets."""

import os
import pty
import select
import struct
import threading
import time
import tty
from collections.abc import Mapping, Sequence

from humanoid_sim.hardware.microstrain import encode_packet, take_packets

BASE_RATE = 1000


class MockImu:
    """Starts idle."""

    def __init__(self) -> None:
        self.attitude: Sequence[float] = (1.0, 0.0, 0.0, 0.0)
        self.rate: Sequence[float] = (0.0, 0.0, 0.0)
        self.force: Sequence[float] = (0.0, 0.0, -1.0)
        self.errors: dict[tuple[int, int], int] = {}
        """Commands, by descriptor set and descriptor, that are refused, each with its error code."""
        self.mute = False
        self.commands: list[tuple[int, int]] = []
        self.decimation = 0
        self.format: list[int] = []
        self._streaming = False
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        self.port = os.ttyname(self._slave)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="mock imu")
        self._thread.start()

    def send(self, data: bytes) -> None:
        """Write bytes to the line."""
        os.write(self._master, data)

    def unplug(self) -> None:
        """End the thread and close the line."""
        if not self._stop.is_set():
            self._stop.set()
            self._thread.join()
            os.close(self._master)
            os.close(self._slave)

    close = unplug

    def _run(self) -> None:
        buffer = bytearray()
        due = 0.0
        while not self._stop.is_set():
            if select.select([self._master], [], [], 0.001)[0]:
                buffer += os.read(self._master, 256)
                for packet in take_packets(buffer):
                    self._obey(*packet)
            if self._streaming and not self.mute and time.monotonic() >= due:
                due = time.monotonic() + self.decimation / BASE_RATE
                quantities = {0x0A: self.attitude, 0x05: self.rate, 0x04: self.force}
                fields = {kind: struct.pack(f">{len(quantities[kind])}f", *quantities[kind]) for kind in self.format}
                self.send(encode_packet(0x80, fields))

    def _obey(self, descriptor_set: int, commands: Mapping[int, bytes]) -> None:
        for descriptor, data in commands.items():
            name = (descriptor_set, descriptor)
            self.commands.append(name)
            if self.mute:
                continue
            fields = {0xF1: bytes((descriptor, self.errors.get(name, 0)))}
            if name in ((0x01, 0x02), (0x01, 0x06)):
                self._streaming = name == (0x01, 0x06)
            elif name == (0x0C, 0x0E):
                fields[0x8E] = data + struct.pack(">H", BASE_RATE)
            elif name == (0x0C, 0x0F):
                entries = [struct.unpack_from(">BH", data, 3 + 3 * i) for i in range(data[2])]
                self.format = [kind for kind, _ in entries]
                self.decimation = entries[0][1]
            self.send(encode_packet(descriptor_set, fields))
