"""Gymnasium, vector and dm_env environments over the same control stack."""

if __name__ != "humanoid_sim.envs":
    raise ImportError("import this package as 'humanoid_sim.envs', not as 'envs'")
