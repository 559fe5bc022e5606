import humanoid_sim.envs  # noqa: F401 - registers the environments
