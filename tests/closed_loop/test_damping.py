import mujoco
import numpy as np
from drive import Drive

from humanoid_sim.messages import Intent, Mode


def energy(drive):
    """J, potential and kinetic."""
    model, data = drive.robot.model, drive.robot.data
    mujoco.mj_energyPos(model, data)
    mujoco.mj_energyVel(model, data)
    return float(data.energy.sum())


def test_damping_only_ever_takes_energy_out():
    drive = Drive()
    drive.stand()
    drive.step(Intent.DAMP)
    energies = []
    for _ in range(1000):
        drive.step()
        energies.append(energy(drive))
    assert np.diff(energies).max() < 0.0
    assert energies[0] - energies[-1] > 1.0
    assert drive.outputs[-1].control_mode.mode is Mode.DAMPING


def test_arms_that_are_let_go_sink_slowly():
    speeds = {}
    for intent in (Intent.DAMP, None):
        drive = Drive()
        drive.stand()
        if intent is None:  # without damping: what ZERO_TORQUE would do
            drive.memory = drive.supervisor.initial()
        drive.step(*([intent] if intent else []))
        drive.run(1.0)
        speeds[intent] = max(np.abs(state.joint_velocity).max() for state in drive.states[-200:])
    assert speeds[Intent.DAMP] < 1.0  # rad/s
    assert speeds[None] > 5.0
