"""The gamepad's program with a pad that SDL makes: its lines of standard input press, release, push and unplug it."""

import contextlib
import os
import sys

from virtual_pads import VirtualPad

from humanoid_sim import gamepad as program
from humanoid_sim.cli import run_program
from humanoid_sim.frontends.gamepad.device import Pad, Pads


class DrivenPads(Pads):
    def __init__(self, *, raw: bool = False) -> None:
        super().__init__(raw=raw)
        self._virtual = VirtualPad()
        self._rest = ""
        os.set_blocking(0, False)

    def look(self) -> tuple[Pad, ...]:
        with contextlib.suppress(BlockingIOError):
            self._rest += os.read(0, 4096).decode()
        *lines, self._rest = self._rest.split("\n")
        for line in lines:
            verb, *words = line.split()
            if verb == "push":
                self._virtual.push(int(words[0]), float(words[1]))
            else:
                getattr(self._virtual, verb)(*words)
        return super().look()


if __name__ == "__main__":
    program.Pads = DrivenPads  # type: ignore[misc]
    sys.exit(run_program(program.main))
