"""Bases of environments: what can be copied, what Gymnasium's render modes show, and what a policy's have in common.

An environment that is pickled or deep-copied is built again from its arguments, then put into the same state. What it
holds beside that state (MuJoCo's threads, views into its memory, windows) cannot be copied, and need not be.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from time import perf_counter, sleep
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt
from gymnasium.envs.registration import EnvSpec
from gymnasium.spaces import Box

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.envs.episode_robot import EpisodeRobot, RandomisedRobot
from humanoid_sim.envs.scenario import Motions, Named, check_options, make_scenario
from humanoid_sim.envs.spaces import observation_space
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.rollout import ClosedLoop
from humanoid_sim.messages import SessionHeader, TickInput, TickOutput, TickRecord
from humanoid_sim.mit import FloatArray
from humanoid_sim.rendering.backend import has_display
from humanoid_sim.rendering.native_viewer import NativeViewerSink
from humanoid_sim.rendering.offscreen import PoseRenderer
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.batch import BatchSimulation
from humanoid_sim.simulation.model import build_model


class CopyableEnv:
    """First base of an environment that can be copied in the middle of an episode; both then go on alike.

    A copy reads files that were named to the first one again, opens no window before it shows something, and is closed
    where the first one was.
    """

    KEPT: tuple[str, ...] = ()
    """Attributes that make up its state, beside those of `_snapshot`."""
    max_episode_steps: int
    """Steps after which every episode is truncated, if it is not over before."""
    _arguments: tuple[tuple[Any, ...], dict[str, Any]]
    _given_spec: EnvSpec | None = None

    def __new__(cls, *arguments: Any, **options: Any) -> Self:
        """Keep what it is built from."""
        self = super().__new__(cls)
        self._arguments = arguments, options
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """For `pickle` and `copy`."""
        arguments, options = self._arguments
        return partial(type(self), *arguments, **options), (), self.snapshot()

    def __setstate__(self, snapshot: dict[str, Any]) -> None:
        """For `pickle` and `copy`, of one that was just built."""
        self.restore(snapshot)

    @property
    def spec(self) -> EnvSpec | None:
        """Return what Gymnasium made it from, with the length of its episodes; None if it was built directly."""
        return self._given_spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None and spec.max_episode_steps is None:
            spec = replace(spec, max_episode_steps=self.max_episode_steps)
        self._given_spec = spec

    def snapshot(self) -> dict[str, Any]:
        """Its present state, for `restore` of one that was built alike; shares arrays with it until it is pickled."""
        common = ("_np_random", "_np_random_seed", "_given_spec", "action_space", "observation_space", "fault_count")
        return {name: vars(self)[name] for name in (*common, *self.KEPT) if name in vars(self)}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Take over a state."""
        vars(self).update(snapshot)


class PolicyEnvironment(CopyableEnv):
    """Base of `PolicyEnv` and `PolicyVectorEnv`."""

    _robots: EpisodeRobot | RandomisedRobot | BatchSimulation

    def _prepare(
        self,
        contract: Named | PolicyContract,
        robot: Named | RobotDescription,
        motion: Motions | None,
        options: Mapping[str, Any],
    ) -> Box:
        """Make the scenario, of options as `make_scenario` takes them; returns the observation space of one robot."""
        check_options(options, type(self), make_scenario)
        self.scenario = scenario = make_scenario(contract, robot, motion, **options)
        self.fault_count = 0
        """Episodes that a fault has ended so far."""
        self._loop: ClosedLoop | None = None
        return observation_space(scenario.wiring)


RENDER_MODES = ["human", "rgb_array"]


def make_pictures(description: RobotDescription, width: int, height: int, camera: str | None) -> PoseRenderer:
    """Return what draws pictures of a robot for `rgb_array`, with a model of their own.

    Raises `InputError` if a picture has no such size.
    """
    for name, pixels in (("width", width), ("height", height)):
        if not isinstance(pixels, int | np.integer) or pixels < 1:
            raise InputError(f"{name}: is {pixels!r}, expected a whole number of pixels >= 1")
    return PoseRenderer(lambda: build_model(description), width, height, camera)


class Window:
    """`human`: MuJoCo's own window, shown in real time. MuJoCo crashes on a second one in the same process."""

    _latest: ClassVar[NativeViewerSink | None] = None

    def __init__(self, description: RobotDescription, period: float) -> None:
        """Open the window. Raises `InputError` if no window can be opened here, or another one is open."""
        if Window._latest is not None and not Window._latest.closed:
            raise InputError("render_mode: human is shown by another environment of this process; close that one first")
        self._period = period
        self._shown = 0
        self._due = perf_counter()
        try:
            self._viewer = NativeViewerSink(lambda: build_model(description))
        except InputError as error:
            reason = str(error).partition(";")[0].removeprefix("viewer native: ")
            raise InputError(f"render_mode: human cannot be shown here: {reason}; use rgb_array instead") from None
        Window._latest = self._viewer
        self._viewer.start(SessionHeader(description.name, description.joint_names, period, 0))

    def show(self, tick: TickInput, output: TickOutput, qpos: FloatArray) -> None:
        """Show a pose (nq,), when it is due: not before a period has passed since the last one."""
        sleep(max(self._due - perf_counter(), 0.0))
        self._due = max(self._due, perf_counter() - self._period) + self._period
        self._viewer.tick(TickRecord(self._shown, tick, output, 0.0, False, qpos))
        self._shown += 1

    def close(self) -> None:
        """Close the window. May be called twice."""
        self._viewer.close()


class ShownEnv(CopyableEnv):
    """Base of environments of one robot, which Gymnasium's render modes show."""

    robot: Any
    _window: Window | None = None

    def _prepare_pictures(
        self,
        description: RobotDescription,
        period: float,
        render_mode: str | None,
        pictures: tuple[int, int, str | None],
    ) -> None:
        """Prepare what is shown. Raises `InputError` if the mode is unknown, or the size of a picture is not possible.

        Args:
            period: s between two poses.
            pictures: width and height in pixels, and the camera of the model; None looks at the robot from the front.
        """
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise InputError(f"render_mode: is {render_mode!r}, expected {', '.join(RENDER_MODES)} or None")
        modes = [mode for mode in RENDER_MODES if mode != "human" or has_display()]  # without a display no window opens
        self.metadata = {"render_modes": modes, "render_fps": round(1.0 / period)}
        self.render_mode = render_mode
        self._pictures = make_pictures(description, *pictures)
        self._shown = description, period

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Return the picture, shape (height, width, 3), in the mode `rgb_array`; the window of `human` shows itself."""
        return self._pictures.draw(self.robot.qpos) if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Close windows and contexts. May be called twice."""
        self._pictures.close()
        if self._window is not None:
            self._window.close()
            self._window = None
        self.robot.close()

    def _show(self, tick: TickInput, output: TickOutput) -> None:
        if self.render_mode == "human":
            if self._window is None:
                self._window = Window(*self._shown)
            self._window.show(tick, output, self.robot.qpos)
