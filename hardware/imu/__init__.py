"""Inertial measurement units: one interface, the simulated one, and a driver for MicroStrain's serial protocol."""
