"""Gymnasium, vector and dm_env environments over the same control stack; importing it registers them with Gymnasium."""

if __name__ != "humanoid_sim.envs":
    raise ImportError("import this package as 'humanoid_sim.envs', not as 'envs'")

from humanoid_sim.envs.registration import register_environments

register_environments()
