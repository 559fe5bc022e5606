"""MuJoCo kept from announcing a broken simulation: here that is a fault, not a line on stderr."""

from __future__ import annotations

from threading import Lock

import mujoco


class _Silence:
    """`with mujoco_silenced:` nothing is written to stderr, and no file MUJOCO_LOG.TXT; `MjData.warning` still counts.

    MuJoCo has one handler of warnings for the whole process, and several simulations may be stepped at the same time:
    who enters takes it, the last to leave puts back what there was. A handler that somebody else set meanwhile counts
    as what there was: it is put back, and does not hear of what is simulated here.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._users = 0
        self._handler: object = None

    def __enter__(self) -> None:
        with self._lock:
            present = mujoco.get_mju_user_warning()
            if present is not _ignore:
                self._handler = present
                mujoco.set_mju_user_warning(_ignore)
            self._users += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._users -= 1
            if self._users == 0 and mujoco.get_mju_user_warning() is _ignore:
                mujoco.set_mju_user_warning(self._handler)


def _ignore(message: str) -> None:
    del message


mujoco_silenced = _Silence()
