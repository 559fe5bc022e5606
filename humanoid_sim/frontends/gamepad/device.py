"""Gamepads as SDL2 knows them (`pygame-ce`): which are there, which of their buttons are down, where their sticks are.

SDL's own table of controllers brings the usual ones, of whatever maker, to one layout: that of `sensor_msgs/Joy` for an
Xbox pad. A pad that it does not know keeps the numbers of its driver.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_BUTTONS = ("A", "B", "X", "Y", "LEFTSHOULDER", "RIGHTSHOULDER", "BACK", "START")
_AXES = ("LEFTX", "LEFTY", "RIGHTX", "RIGHTY", "TRIGGERLEFT", "TRIGGERRIGHT")
_FULL = 32767.0
_ENVIRONMENT = {
    "PYGAME_HIDE_SUPPORT_PROMPT": "1",
    "SDL_VIDEODRIVER": "dummy",  # a gamepad needs no window, and no window's focus
    "SDL_AUDIODRIVER": "dummy",
    "SDL_JOYSTICK_ALLOW_BACKGROUND_EVENTS": "1",
    "SDL_NO_SIGNAL_HANDLERS": "1",
}


def missing_reason(folder: Path = Path("/dev/input")) -> str:
    """Return why no gamepad is found: device nodes that are not there, or not readable and whose they are."""
    nodes = sorted(folder.glob("event*"))
    if not nodes:
        return f"no gamepad is plugged in: {folder} has no event nodes"
    closed = [node for node in nodes if not os.access(node, os.R_OK)]
    if not closed:
        return "no gamepad is plugged in"
    try:
        group = closed[0].group()
    except KeyError:  # a group without a name
        group = str(closed[0].stat().st_gid)
    return (
        f"no gamepad is plugged in that can be read: {len(closed)} of {len(nodes)} event nodes, such as {closed[0]}, "
        f"are for group '{group}'; join it (sudo usermod -aG {group} $USER) and log in again"
    )


@dataclass(frozen=True, slots=True)
class Pad:
    """One gamepad, as it is now."""

    identity: int
    """SDL's instance id: another one after each time it is plugged in."""
    name: str
    is_known: bool
    """To SDL's table of controllers: its buttons are in the usual order."""
    buttons: tuple[bool, ...]
    axes: tuple[float, ...]
    """-1 to 1."""

    def __str__(self) -> str:
        return f"{self.name} ({len(self.buttons)} buttons, {'known' if self.is_known else 'unknown'} layout)"


class Pads:
    """The gamepads of this machine. One object a process, used on one thread."""

    def __init__(self, *, raw: bool = False) -> None:
        """Start SDL; `raw` keeps the numbers of the driver for pads of a known layout too."""
        os.environ.update(_ENVIRONMENT)
        import pygame  # noqa: PLC0415 - reads the environment above
        from pygame._sdl2 import controller  # noqa: PLC0415

        self._pygame, self._controller = pygame, controller
        self._raw = raw
        pygame.display.init()  # its queue is the one that events go through
        pygame.joystick.init()
        controller.init()
        self._buttons = [getattr(pygame, f"CONTROLLER_BUTTON_{name}") for name in _BUTTONS]
        self._axes = [getattr(pygame, f"CONTROLLER_AXIS_{name}") for name in _AXES]
        self._open: dict[int, tuple[Any, Any]] = {}
        """By instance id: the joystick, and the controller of a known one."""

    def look(self) -> tuple[Pad, ...]:
        """Those that are there now, in the order in which they came."""
        for event in self._pygame.event.get():
            if event.type == self._pygame.JOYDEVICEREMOVED:
                self._forget(event.instance_id)
        for index in range(self._pygame.joystick.get_count()):
            try:
                joystick = self._pygame.joystick.Joystick(index)
                if joystick.get_instance_id() not in self._open:
                    known = not self._raw and self._controller.is_controller(index)
                    self._open[joystick.get_instance_id()] = (
                        joystick,
                        self._controller.Controller(index) if known else None,
                    )
            except self._pygame.error:  # unplugged just now
                continue
        pads = []
        for identity, (joystick, controller) in list(self._open.items()):
            try:
                pads.append(self._read(identity, joystick, controller))
            except self._pygame.error:
                self._forget(identity)
        return tuple(pads)

    def close(self) -> None:
        """Let go of all."""
        for identity in list(self._open):
            self._forget(identity)
        self._controller.quit()
        self._pygame.joystick.quit()
        self._pygame.display.quit()

    def _forget(self, identity: int) -> None:
        for handle in self._open.pop(identity, ()):
            if handle is not None:
                handle.quit()

    def _read(self, identity: int, joystick: Any, controller: Any) -> Pad:
        if controller is not None:
            if not controller.attached():
                raise self._pygame.error("gone")
            buttons = tuple(bool(controller.get_button(button)) for button in self._buttons)
            axes = tuple(max(controller.get_axis(axis) / _FULL, -1.0) for axis in self._axes)
        else:
            buttons = tuple(bool(joystick.get_button(index)) for index in range(joystick.get_numbuttons()))
            axes = tuple(float(joystick.get_axis(index)) for index in range(joystick.get_numaxes()))
        return Pad(identity, joystick.get_name(), controller is not None, buttons, axes)
