"""Gymnasium, vector and dm_env environments over the same control stack; importing it registers them with Gymnasium."""

from gymnasium.envs.registration import register, registry

if __name__ != "humanoid_sim.envs":
    raise ImportError("import this package as 'humanoid_sim.envs', not as 'envs'")

_CONFIGS = {"LiteTracking": "lite_tracking", "BipedVelocity": "biped_velocity", "LitePiano": "lite_piano"}
ENVIRONMENTS = (*(f"humanoid_sim/{name}-v0" for name in _CONFIGS), "humanoid_sim/LiteModes-v0")

if ENVIRONMENTS[0] not in registry:
    for _name, _config in _CONFIGS.items():
        register(
            f"humanoid_sim/{_name}-v0",
            "humanoid_sim.envs.policy_env:PolicyEnv",
            vector_entry_point="humanoid_sim.envs.vector_env:PolicyVectorEnv",
            kwargs={"config": _config},
        )
    register(
        ENVIRONMENTS[-1],
        "humanoid_sim.envs.modes_env:ModesEnv",
        vector_entry_point="humanoid_sim.envs.modes_env:ModesVectorEnv",
    )
