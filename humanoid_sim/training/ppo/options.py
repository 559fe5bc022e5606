"""The options of `train` and `curves`. Nothing heavy is imported here: `--help` must be quick."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import tyro


@dataclass(frozen=True)
class TrainConfig:
    """Train a policy for any task and robot, with PPO of stable-baselines3 or of rsl_rl, and write it as ONNX.

    Needs the extra `rl`. The folder gets progress.csv, TensorBoard's logs and checkpoints; at the end the policy is
    exported with its contract and golden vectors, and `regress` measures it.
    """

    task: str = "auto"
    """{humanoid_sim.envs.tasks.TASKS}, or auto: the one that the contract was made for. In tracking, arms follow the
    bodies of a motion; in motion, a whole body does; walking is velocity with a gait on the contract's clock. Or a
    class of your own: FILE.py:CLASS or MODULE:CLASS, as examples/own_task.py:HoldTask."""
    robot: str = "lite"
    """A shipped robot ({robots}), the path of a robot's YAML file or of an MJCF."""
    contract: str | None = None
    """Contract of the policy: a contract.yaml, a checkpoint (.onnx) whose contract is taken, or a
    shipped name. Default: that of the environment for the robot, LiteTracking-v0, BipedVelocity-v0 or LitePiano-v0."""
    motion: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """Motion for a policy that follows one: a sample motion ({motions}), or a file (.mcap); for the
    piano a sample song or a MIDI file. Given several times, each episode has one of them. Default: that of the
    environment for the contract, wave or ode_to_joy."""
    reference_start: float = 0.0
    """Share of the episodes, 0 to 1, that begin at a random frame of the motion, in the motion's own state."""
    algorithm: str = "ppo-sb3"
    """ppo-sb3: PPO of stable-baselines3; ppo-rsl_rl: that of rsl_rl."""
    steps: int = 2_000_000
    """Policy steps of all robots together at which the training ends."""
    minutes: float | None = None
    """End sooner, after so many minutes of training, earlier runs of the folder counted in. Default: no limit."""
    robots: int = 128
    """Number of environments simulated at once."""
    randomisation: str | None = None
    """A YAML file of fields of the environments' randomisation, such as `mass: [0.9, 1.1]`. Default: none."""
    terrain: str = "flat"
    """Ground under a floating base: flat, rough, slopes, steps, mixed, or a YAML file of a terrain's fields, such as
    `kind: steps`."""
    curriculum: str | None = None
    """Shares of the commands, the terrain and the randomisation over the training: a YAML file such as
    `push: [[0.5, 0], [1, 1]]` (nothing until half of it is done, then more and more), or a function of the progress,
    FILE.py:FUNCTION or MODULE:FUNCTION, as examples/growing_harder.py:harder. Default: all from the beginning."""
    curriculum_steps: int | None = None
    """Policy steps after which the curriculum's progress is 1. Default: --steps of the run's beginning."""
    privileged: tuple[str, ...] = ()
    """Terms that the critic sees as well as the observation, such as base_linear_velocity; with ppo-rsl_rl."""
    actuation: Literal["implicit", "affine"] = "implicit"
    """Simulation of the motors: implicit is several times as fast, affine agrees with the reference."""
    physics_timestep: float | None = None
    """s. Default: what suits robot and plant; 2.5 ms for implicit."""
    folder: str | None = None
    """For checkpoints and logs; made if it is missing. Default: runs/train/ROBOT-TASK-ALGORITHM."""
    output: str | None = None
    """The policy (.onnx). Default: policy.onnx in the folder."""
    resume: bool = False
    """Go on from the folder's checkpoint, after Ctrl-C too, with the same options as before. --steps, --minutes,
    --output and what is shown meanwhile may differ."""
    checkpoint_seconds: float = 60.0
    """s of wall time between two checkpoints."""
    video_minutes: float | None = None
    """Every so many minutes, make a video of an episode of the policy as it is then. Default: none."""
    tensorboard: bool = True
    """Write TensorBoard logs."""
    regress: bool = True
    """Measure the policy at the end with the shipped suite for the task, where there is one."""
    seed: int = 0
    """Random seed. Resumed or time-limited trainings are not bit-identical to an uninterrupted one."""
    threads: int = 1
    """Threads of PyTorch. Physics takes all processors; the networks are too small to gain from more than one."""

    GROUPS: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "most used": ("task", "robot", "contract", "motion", "steps", "minutes", "folder", "output", "resume"),
        "episodes": ("reference_start", "terrain", "randomisation", "curriculum", "curriculum_steps"),
        "training": ("algorithm", "robots", "privileged", "seed", "threads"),
        "simulation": ("actuation", "physics_timestep"),
        "what is kept and measured": ("checkpoint_seconds", "video_minutes", "tensorboard", "regress"),
    }
    EXAMPLES: ClassVar[tuple[tuple[str, str], ...]] = (
        ("--robot lite_biped --minutes 30", "a policy that walks"),
        ("--robot lite_biped --minutes 60 --resume", "go on for half an hour more"),
        ("--robot lite_biped --terrain mixed", "ground that is not flat"),
        ("--motion wave --reference-start 0.8", "a motion, mostly from anywhere in it"),
    )


@dataclass(frozen=True)
class CurvesConfig:
    """Draw the learning curves of runs of `train`: return over policy steps, and over wall time."""

    runs: tuple[str, ...]
    """Folders of `train`; runs of the same robot and task share a diagram."""
    output: str = "learning-curves.png"
    """The picture (.png)."""
