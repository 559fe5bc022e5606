"""Many simulated robots at once, for vector environments, training and regression."""

from humanoid_sim.simulation.batch.randomisation import Randomisation
from humanoid_sim.simulation.batch.simulation import BatchSimulation

__all__ = ["BatchSimulation", "Randomisation"]
