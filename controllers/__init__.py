"""The pure part of the control stack: FSM, controllers, observation, action and supervisor.

NumPy and the standard library only: no clock, no file, no simulator. Whatever touches the world is outside.

| module | what it knows |
|---|---|
| `supervisor` | one tick: transition, activation, update, and the chain of fallbacks |
| `fsm` | modes and intents: `MODES`, `RULES`, and what safety does |
| `base` | what a controller is |
| `guards` | what watches the joints while a controller drives them |
| `damping`, `standby`, `rl_policy`, `remote_policy` | the controllers; `damping` holds ZERO_TORQUE too |
| `policy_step` | one step of a policy: from its observation to its command |
| `observation` | the observation's layout, and its history |
| `term_kinds` | the one table of observation terms; `term_values` holds what they are made of |
| `terms`, `contract` | a term, and everything a checkpoint needs, as written down |
| `reference` | the motion that a policy follows |
| `rotation` | quaternions and matrices |
| `parameters` | validation of parameters, joint names and commands |
| `joy` | a gamepad's buttons as intents |
"""

if __name__ != "humanoid_sim.controllers":
    raise ImportError("import this package as 'humanoid_sim.controllers', not as 'controllers'")
