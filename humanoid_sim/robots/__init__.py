"""Robots: what one is (the description), and the ways to have one (simulated, looped back, replayed)."""
