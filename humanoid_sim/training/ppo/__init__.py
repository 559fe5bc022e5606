"""Training any task of the environments with another library's PPO: `python -m humanoid_sim.training train`."""
