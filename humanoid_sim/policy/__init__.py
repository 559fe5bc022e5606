"""Checkpoints and motions: reading what a policy needs, and running it outside the pure part."""
