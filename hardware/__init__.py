"""Motors on a CAN bus: protocol, bus, robot adapter, emulated motors and bench tools."""

if __name__ != "humanoid_sim.hardware":
    raise ImportError("import this package as 'humanoid_sim.hardware', not as 'hardware'")
