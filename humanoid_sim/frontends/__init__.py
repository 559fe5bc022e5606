"""Programs beside the loop: each reads a session's ticks, sends intents and data, and may die at any time.

A front end is a module `humanoid_sim/<name>.py`, and a verb; its parts are here. `play` starts it as a child process,
anybody else later with `python -m humanoid_sim.<name>`; its first line says that it runs.
"""
