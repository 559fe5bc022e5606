"""The pure part of the control stack: NumPy and the standard library only; no clock, no file, no simulator."""

if __name__ != "humanoid_sim.controllers":
    raise ImportError("import this package as 'humanoid_sim.controllers', not as 'controllers'")
