"""A whole song on a simulated piano, by a policy or open loop: its score, the hardest touch, and what else touched."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import msgspec
import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.policy_step import Policy, PolicyWiring
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.piano_player import PianoPlayer
from humanoid_sim.evaluation.piano_score import PianoScore, score
from humanoid_sim.evaluation.rollout import ClosedLoop, OneRobot
from humanoid_sim.mit import FloatArray, MITCommand
from humanoid_sim.policy.song import key_name
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.keys import Touch
from humanoid_sim.simulation.mujoco_robot import MujocoRobot
from humanoid_sim.simulation.plant import Actuation


@dataclass(frozen=True, slots=True)
class PlayedSong:
    """Result of one song."""

    score: PianoScore
    touch: Touch | None
    """The hardest; None where no key was touched."""
    contacts: tuple[str, ...]
    """Contacts beside those of hands and keys, as `a and b`, each pair of bodies once: there should be none."""

    @property
    def figures(self) -> tuple[float, float, float, float]:
        """Precision, recall and F1 per time step, and the hardest touch in N."""
        steps = self.score.steps
        return steps.precision, steps.recall, steps.f1, 0.0 if self.touch is None else self.touch.force

    def problems(self, force_limit: float) -> tuple[str, ...]:
        """Return what a robot should not do: touch a key with more than `force_limit` N, or anything else at all."""
        found = [f"{contact} touched" for contact in self.contacts]
        if self.touch is not None and self.touch.force > force_limit:
            key = key_name(self.touch.key)
            found.insert(0, f"{key} was touched with {self.touch.force:.1f} N, the limit is {force_limit:g} N")
        return tuple(found)


def play_with_policy(
    description: RobotDescription,
    wiring: PolicyWiring,
    policy: Policy,
    table: npt.NDArray[np.floating],
    actuation: Actuation = "qfrc_applied",
) -> PlayedSong:
    """Play a song in closed loop. Raises `InputError` if a controller would refuse an observation or an action.

    Args:
        description: of the robot, with the policy's gains, where the song begins.
        wiring: of the policy, with the song as its reference.
        table: shape (F, 88), 0 or 1: the goals of the same song, one row per policy step.
    """
    period = wiring.contract.policy_dt
    robot = MujocoRobot(description, control_period=period, actuation=actuation)
    loop = ClosedLoop(OneRobot(robot), wiring, np.zeros(3))

    def answer(observation: npt.NDArray[np.float32], frame: int) -> npt.NDArray[np.float32]:
        return np.asarray(policy(observation, frame), dtype=np.float32)

    def advance(frame: int) -> None:
        action, accepted = loop.infer(answer)
        if not accepted:
            why = wiring.observation_problem(loop.observation) or wiring.action_problem(action)
            raise InputError(f"policy: at {frame * period:.2f} s of the song: {why}")
        loop.act(action)

    return _played(robot, advance, table, period)


def play_open_loop(
    description: RobotDescription,
    player: PianoPlayer,
    table: npt.NDArray[np.floating],
    period: float,
    actuation: Actuation = "qfrc_applied",
) -> PlayedSong:
    """Play a song with the commands that follow from its goals alone: shape (F, 88), 0 or 1, one row per `period` s.

    The servos have the gains of the description; the player is of the same robot and period.
    """
    ready = description.standby_controller_a.pose_segments[-1]
    description = msgspec.structs.replace(description, initial_position=ready)
    robot = MujocoRobot(description, control_period=period, actuation=actuation)
    commands, still = player.play(table), np.zeros(description.joint_count)

    def advance(frame: int) -> None:
        robot.write(MITCommand(commands[frame], still, still, description.stiffness, description.damping))

    return _played(robot, advance, table, period)


def _played(
    robot: MujocoRobot, advance: Callable[[int], None], table: npt.NDArray[np.floating], period: float
) -> PlayedSong:
    pressed: FloatArray = np.zeros(table.shape)
    for frame in range(len(table)):
        pressed[frame] = robot.pressed_keys
        advance(frame)
    return PlayedSong(score(pressed, table, period), robot.hardest_touch, robot.other_contacts)
