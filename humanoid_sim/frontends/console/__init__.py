"""The console: a page for the operator, in a browser, on a running session."""

from humanoid_sim.frontends.console.program import ConsoleConfig, main

__all__ = ["ConsoleConfig", "main"]
