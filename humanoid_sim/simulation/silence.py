"""MuJoCo kept from announcing a broken simulation: here that is a fault, not a line on stderr."""

from __future__ import annotations

from threading import Lock

import mujoco

__all__ = ["mujoco_silenced"]


class _Silence:
    """`with mujoco_silenced:` nothing is written to stderr, and no file MUJOCO_LOG.TXT; `MjData.warning` still counts.

    MuJoCo has one handler of warnings for the whole process, and several simulations may be stepped at the same time:
    the first to enter takes it, the last to leave puts back what there was.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._users = 0
        self._handler: object = None

    def __enter__(self) -> None:
        with self._lock:
            if self._users == 0:
                self._handler = mujoco.get_mju_user_warning()
                mujoco.set_mju_user_warning(_ignore)
            self._users += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._users -= 1
            if self._users == 0:
                mujoco.set_mju_user_warning(self._handler)


def _ignore(message: str) -> None:
    del message


mujoco_silenced = _Silence()
