"""How the sample policy and the sample motions are made, and measured: `python -m humanoid_sim.training`."""
