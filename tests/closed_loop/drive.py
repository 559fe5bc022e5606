"""The whole stack around a simulated Lite, one tick at a time."""

import numpy as np

from humanoid_sim.messages import Intent, TickInput, TickOutput
from humanoid_sim.mit import FloatArray, MITState
from humanoid_sim.policy.loaded_policy import LoadedPolicy
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.model import SimConfig
from humanoid_sim.simulation.sim_robot import SimRobot
from humanoid_sim.stack import build_supervisor

PERIOD = 0.005


class Drive:
    """Steps robot and supervisor in turn and keeps what passed between them."""

    def __init__(self, loaded: LoadedPolicy | None = None) -> None:
        self.description = load_robot("lite")
        self.robot = SimRobot(self.description, SimConfig(control_period=PERIOD))
        self.supervisor = build_supervisor(self.description, PERIOD, loaded)
        self.memory = self.supervisor.initial()
        self.states: list[MITState] = []
        self.outputs: list[TickOutput] = []

    @property
    def time(self) -> float:
        """s, robot's clock at the latest reading."""
        return float(self.states[-1].time)

    @property
    def position(self) -> FloatArray:
        """Shape (n,), rad, at the latest reading."""
        return self.states[-1].joint_position

    def step(self, *intents: Intent) -> TickOutput:
        """One tick."""
        state, safety = self.robot.read()
        self.memory, output = self.supervisor.step(self.memory, TickInput(state, safety, intents))
        self.robot.write(output.command)
        self.states.append(state)
        self.outputs.append(output)
        return output

    def run(self, seconds: float) -> None:
        """Ticks without intents."""
        for _ in range(round(seconds / PERIOD)):
            self.step()

    def stand(self, load: Intent = Intent.LOAD_A) -> None:
        """DAMPING, then STANDBY until it is finished."""
        self.step(Intent.DAMP)
        self.step(load)
        while not self.outputs[-1].standby.is_finished:  # type: ignore[union-attr]
            self.step()

    def applied(self, since: int = 0) -> FloatArray:
        """Shape (ticks, n), N·m: the torques that the motors applied, from tick `since` on."""
        return np.array([state.joint_effort for state in self.states[since:]])
