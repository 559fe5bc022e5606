"""Emulated Robstride motors: firmware at the level of frames, CAN buses with their timing, MuJoCo as what they move.

`emulator.Emulator` is the simulation, `virtual.VirtualMotors` runs it on python-can channels in a thread of this
process, `python -m humanoid_sim.hardware emulate` in a process of its own. `faults` are faults on purpose.
"""
