"""An environment for LeRobot's hub: upload this file, and `make_env("you/repository", trust_remote_code=True)` has it.

Whoever uses it installs `humanoid_sim` beside LeRobot.
"""

from humanoid_sim.envs.lerobot import hub_entry

make_env = hub_entry("humanoid_sim/LiteTracking-v0", task="Wave with both arms.", motion="wave")
