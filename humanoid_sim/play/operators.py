"""Who drives the FSM in a run: operators, and a script that they may take over from."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from humanoid_sim.errors import InputError
from humanoid_sim.messages import SafetyStatus
from humanoid_sim.session.control_socket import ControlSocket
from humanoid_sim.session.keyboard import Keyboard, key_help
from humanoid_sim.session.reactivation import Reactivation
from humanoid_sim.session.script import OverriddenScript, Script
from humanoid_sim.session.session import SafetyFilter
from humanoid_sim.session.sources import IntentSource, VelocityCommand, velocity_key_help

__all__ = ["Operator", "drive", "keys_of", "open_operators"]

Operator = Keyboard | ControlSocket


def open_operators(
    manual: bool,
    velocity: VelocityCommand | None,
    reactivation: Reactivation,
    tell: Callable[[str], None],
) -> tuple[Operator, ...]:
    """The operators of a run: the control socket, and the keyboard if somebody sits at it.

    Args:
        manual: take over the terminal.
        velocity: what the velocity keys change; None for a policy that does not walk.
        reactivation: what they ask for to begin afresh.
        tell: shows the operator at the keyboard a line.

    Raises:
        InputError: if one cannot be opened; none is open then.
    """
    socket = ControlSocket(reactivation)
    if not manual:
        return (socket,)
    try:
        return socket, Keyboard(velocity, reactivation=reactivation, tell=tell)
    except InputError:
        socket.close()
        raise


def keys_of(manual: bool, *, walks: bool) -> tuple[str, ...]:
    """Lines that name the keys, for an operator at the keyboard."""
    if not manual:
        return ()
    return (key_help(), velocity_key_help()) if walks else (key_help(),)


def drive(
    operators: Sequence[IntentSource], script: Script | None, safety: SafetyFilter
) -> tuple[tuple[IntentSource, ...], SafetyFilter]:
    """The sources of intents, and the safety filter with the script, if there is one, looking on."""
    if script is None:
        return tuple(operators), safety

    def watched(statuses: tuple[SafetyStatus, ...]) -> tuple[SafetyStatus, ...]:
        filtered = safety(statuses)
        script.note_safety(filtered)
        return filtered

    return (OverriddenScript(script, operators),), watched
