"""A MIDI keyboard for a running session: from its bytes to the keys that are down."""
