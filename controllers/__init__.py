"""The pure part of the control stack: FSM, controllers, observation, action and supervisor.

NumPy and the standard library only: no clock, no file, no simulator. Whatever touches the world is outside.
"""

if __name__ != "humanoid_sim.controllers":
    raise ImportError("import this package as 'humanoid_sim.controllers', not as 'controllers'")
