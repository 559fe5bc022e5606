"""Intents from another process on the same machine: a local socket that a running session listens on.

One datagram is one intent's name, or `reactivate`; the answer is what the session made of it in its next tick: a digit,
0 if it was refused or failed, and a line of text. The socket lies in a folder that only its user can enter, and never
crosses a network.
"""

from __future__ import annotations

import os
import socket
import stat
import tempfile
from collections.abc import Sequence
from pathlib import Path

from humanoid_sim.errors import InputError
from humanoid_sim.messages import Intent, TickOutput
from humanoid_sim.session.reactivation import REACTIVATE, Answer, Reactivation
from humanoid_sim.session.sources import IntentSource

__all__ = ["ControlSocket", "running_sessions", "send_intent", "send_reactivate"]

_LONGEST = 64
"""Bytes; no intent's name is longer."""
_MOST = 16
"""Messages that one tick takes: a sender that floods the socket must not keep the loop."""
_SUFFIX = ".session"


def _folder() -> Path:
    """The folder of the sockets, made for its user alone.

    Raises:
        InputError: if it exists and belongs to somebody else, or others may enter it.
    """
    base = Path(os.environ.get("XDG_RUNTIME_DIR", ""))
    if not base.is_absolute() or not base.is_dir():  # left over from another user, as `su` does
        base = Path(tempfile.gettempdir())
    folder = base / f"humanoid_sim-{os.getuid()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made: {error.strerror}") from None
    status = folder.lstat()
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid() or status.st_mode & 0o077:
        raise InputError(f"{folder}: is not a folder that only its user can enter; remove it")
    return folder


class ControlSocket(IntentSource):
    """Fed by `send_intent` and `send_reactivate`."""

    def __init__(self, reactivation: Reactivation | None = None) -> None:
        """Open the socket of this process.

        Args:
            reactivation: what `reactivate` asks for.

        Raises:
            InputError: if it cannot be opened.
        """
        self._path = _folder() / f"{os.getpid()}{_SUFFIX}"
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._path.unlink(missing_ok=True)  # of a process that had this id before and was killed
            self._socket.bind(str(self._path))
        except OSError as error:
            self._socket.close()
            raise InputError(f"{self._path}: cannot listen for intents: {error.strerror or error}") from None
        self._waiting: list[str] = []
        self._reactivation = reactivation
        self._reactivating: list[str] = []

    def poll(self, time: float, output: TickOutput | None) -> Sequence[Intent]:
        """Answer the senders of the last tick, then take what has arrived since."""
        if self._waiting and output is not None:
            control = output.control_mode
            text = f"{control.mode.name} ({control.controller_name}): {control.status_message}"
            self._answer(self._waiting, Answer(not output.refusals, text))
        if self._reactivating and self._reactivation is not None and self._reactivation.answer:
            self._answer(self._reactivating, self._reactivation.answer)
        intents: list[Intent] = []
        for _ in range(_MOST):
            try:
                message, sender = self._socket.recvfrom(_LONGEST)
            except OSError:  # nothing more
                break
            word = message.decode(errors="replace")
            if word == REACTIVATE and self._reactivation is not None:
                self._reactivation.request()
                self._reactivating += [sender] if sender else []
                continue
            try:
                intents.append(Intent(word))
            except ValueError:
                continue
            if sender:
                self._waiting.append(sender)
        return intents

    def close(self) -> None:
        """Close and remove the socket."""
        for waiting in (self._waiting, self._reactivating):
            self._answer(waiting, Answer(True, "the session has ended"))
        self._socket.close()
        self._path.unlink(missing_ok=True)

    def _answer(self, waiting: list[str], answer: Answer) -> None:
        message = f"{answer.granted:d}{answer.text}".encode()
        for sender in waiting:
            try:
                self._socket.sendto(message, sender)
            except OSError:  # the sender did not wait
                continue
        waiting.clear()


def running_sessions() -> list[int]:
    """Process ids of this user's sessions."""
    found = []
    for path in _folder().glob(f"*{_SUFFIX}"):
        try:
            process = int(path.stem)
            os.kill(process, 0)
        except (ValueError, ProcessLookupError):
            path.unlink(missing_ok=True)
        except PermissionError:
            continue
        else:
            found.append(process)
    return sorted(found)


def send_intent(process: int, intent: Intent, timeout: float = 2.0) -> Answer:
    """Send an intent to a session and wait for its answer.

    Args:
        process: id of the session's process.
        intent: what is asked for.
        timeout: s

    Raises:
        InputError: if there is no such session, or it does not answer.
    """
    return _send(process, intent.value, timeout)


def send_reactivate(process: int, timeout: float = 30.0) -> Answer:
    """Have a session verify and enable its robot afresh, and wait for what becomes of it; otherwise like `send_intent`.

    The time allows for a bus with many motors, each of which is asked for its identity.
    """
    return _send(process, REACTIVATE, timeout)


def _send(process: int, word: str, timeout: float) -> Answer:
    folder = _folder()
    reply = folder / f"{os.getpid()}.reply"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as client:
        reply.unlink(missing_ok=True)
        client.settimeout(timeout)
        try:
            client.bind(str(reply))
            client.sendto(word.encode(), str(folder / f"{process}{_SUFFIX}"))
            answer = client.recv(4096).decode(errors="replace")
            return Answer(answer.startswith("1"), answer[1:])
        except TimeoutError:
            raise InputError(f"session {process}: did not answer within {timeout:g} s") from None
        except OSError as error:
            raise InputError(f"session {process}: cannot be reached: {error.strerror or error}") from None
        finally:
            reply.unlink(missing_ok=True)
