"""Gymnasium, vector and dm_env environments over the same control stack.

| module | what it knows |
|---|---|
| `tasks` | where an episode starts, its reward and its end; functions of arrays, for one robot or many |
| `scenario` | robot, contract, motion and task, brought together from what a user names; where an episode begins |
| `reference_states` | the beginning of an episode in the middle of a motion |
| `curriculum` | how much of randomisation and commands counts while training goes on |
| `episode_robot` | one robot, as its description says or with what is drawn for its episodes |
| `base` | what environments have in common: copies, and a policy's scenario |
| `policy_env` | one robot: `LiteTracking-v0`, `BipedVelocity-v0`, `Policy-v0` |
| `vector_env` | many robots at once, stepped natively: the same ids through `gymnasium.make_vec` |
| `modes_env` | the whole control stack: `LiteModes-v0` |
| `dm` | the same tasks for dm_control |
| `registration` | the ids |
"""

if __name__ != "humanoid_sim.envs":
    raise ImportError("import this package as 'humanoid_sim.envs', not as 'envs'")
