"""Many simulated robots at once, for vector environments, training and regression."""

from humanoid_sim.envs.batch.randomisation import Randomisation
from humanoid_sim.envs.batch.simulation import BatchSimulation

__all__ = ["BatchSimulation", "Randomisation"]
