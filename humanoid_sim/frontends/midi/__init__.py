"""A MIDI keyboard for a running session: from its bytes to the keys that are down."""

from humanoid_sim.frontends.midi.program import main

__all__ = ["main"]
