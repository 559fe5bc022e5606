"""Mock motors: they speak the families' protocols frame by frame on python-can channels, and MuJoCo moves them.

`motors.MockMotors` is the simulation, `server.MockServer` runs it in a thread on channels. They share the protocols
with the drivers and nothing else.
"""
