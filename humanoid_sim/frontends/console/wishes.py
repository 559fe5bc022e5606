"""Messages from pages other than intents: wishes for the sliders and the velocity, and the page's heartbeat."""

from __future__ import annotations

import msgspec

from humanoid_sim.errors import FieldError
from humanoid_sim.frontends.console.sliders import Goals

SEEN_WITHIN = 1.0
"""Largest age of what a page shows while it commands, s.

A page's heartbeat comes from a thread that drawing does not delay; what it shows, from the one that draws and hears
keys. So this is how long that one may stand still: two frames where software draws two a second.
"""


class _Wish(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="do"):
    """A message from a page; `do` names its kind."""


class Take(_Wish, frozen=True, tag="take"):
    """Move this joint by sliders."""

    joint: str


class Snap(_Wish, frozen=True, tag="snap"):
    """The sliders to where the joint is, with gains 0."""


class LetGo(_Wish, frozen=True, tag="let_go"):
    """Neither joint nor velocity is commanded any more: asked for, or the page is hidden."""


class Beat(_Wish, frozen=True, tag="beat"):
    """The page is there and in sight; repeated by a thread of its own, with what the one that draws said last."""

    seen: float
    """Newest `sent` that the page has received, s, on the console's clock."""
    number: int = 0
    """Number of the turn that the goals belong to."""
    goals: Goals | None = None


class Steer(_Wish, frozen=True, tag="steer"):
    """One component of the velocity command."""

    axis: int
    """0 to 2: vx, vy, yaw rate."""
    value: float
    """m/s or rad/s."""


class Press(_Wish, frozen=True, tag="press"):
    """A velocity key."""

    key: str
    """Name in `VELOCITY_KEYS`."""


Wish = Take | Snap | LetGo | Beat | Steer | Press
_DECODER = msgspec.json.Decoder(Wish)


def parse_wish(message: str | bytes) -> Wish:
    """Return a page's message, which says what to `do`.

    Raises `FieldError` if it is not a wish, or a field is wrong.
    """
    try:
        wish: Wish = _DECODER.decode(message)
    except (msgspec.MsgspecError, UnicodeError, RecursionError) as error:
        raise FieldError(f"not understood: {str(error)[:200]}") from None
    return wish
