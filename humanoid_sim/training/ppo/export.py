"""A trained policy as a checkpoint that needs no other file: graph, contract, golden vectors."""

from __future__ import annotations

import copy
import os
import tempfile
import warnings
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
import onnx
from gymnasium.vector import VectorActionWrapper, VectorObservationWrapper

from humanoid_sim.assets import motion_path
from humanoid_sim.controllers.contract import PolicyContract, TensorNames
from humanoid_sim.envs.policy_env import PolicyEnv
from humanoid_sim.envs.scenario import Motions, Scenario
from humanoid_sim.envs.vector_env import PolicyVectorEnv
from humanoid_sim.errors import HumanoidSimError, InputError
from humanoid_sim.evaluation.rollout import ClosedLoop
from humanoid_sim.files import output_file
from humanoid_sim.policy.checkpoint import Checkpoint, load_checkpoint
from humanoid_sim.policy.contract_json import STAMP_KEY, encode
from humanoid_sim.policy.golden.samples import STATE_ARRAYS
from humanoid_sim.policy.metadata import write_metadata
from humanoid_sim.policy.motion import Motion, write_motion
from humanoid_sim.policy_tools.stamp import stamp
from humanoid_sim.simulation.batch import BatchSimulation
from humanoid_sim.training.ppo.learner import Actor, Float32Array

_CHANGING = (gymnasium.ObservationWrapper, gymnasium.ActionWrapper, VectorObservationWrapper, VectorActionWrapper)
_INSIDE = ("env", "venv", "envs")
"""Attributes in which wrappers of Gymnasium and of the libraries keep what they wrap."""
_PROBES = 64
_OPSET = 17
"""Runtimes from 2022 on read it."""
_TOLERANCE = 1e-4
"""Difference of an action, absolute up to 1 and relative beyond: ONNX Runtime adds up in another order than PyTorch."""
_STEPS = 100
"""Policy steps of the run that golden vectors are taken from, at most."""


def actor_of(model: Any, envs: Any = None) -> Actor:
    """Return the actor of a model. Raises `InputError` if it is not such a model.

    Args:
        envs: around which it was trained; those of stable-baselines3 may normalise observations.
    """
    library = {kind.__module__.partition(".")[0] for kind in type(model).__mro__}
    if "stable_baselines3" in library:
        from humanoid_sim.training.ppo import sb3  # noqa: PLC0415 - one of them is enough

        return sb3.actor_of(model, envs)
    if "rsl_rl" in library:
        from humanoid_sim.training.ppo import rsl  # noqa: PLC0415

        return rsl.actor_of(model)
    raise InputError(f"model: is a {type(model).__name__}, expected a model of stable-baselines3 or a runner of rsl_rl")


def export(model: Any, envs: Any, output: str | os.PathLike[str]) -> Path:
    """See `humanoid_sim.training.export_policy`."""
    path = output_file(output, "output", ".onnx")
    env = _environment(envs)
    scenario, actor = env.scenario, actor_of(model, envs)
    contract = scenario.contract_as_read
    if scenario.motion is None and contract.task_type != "locomotion":
        raise InputError("envs: their policy carries its motion itself, which a new one will not; give them motion=")
    widths = scenario.wiring.layout.width, scenario.contract.action_count
    if actor.widths != widths:
        raise InputError(
            f"model: takes {actor.widths[0]} values and gives {actor.widths[1]}, expected {widths[0]} and {widths[1]} "
            "of these environments"
        )
    probes = np.random.default_rng(0).normal(size=(_PROBES, widths[0])).astype(np.float32)
    with tempfile.TemporaryDirectory() as folder:
        plain, trace = Path(folder) / "plain.onnx", Path(folder) / f"{path.stem}.npz"
        write_network(plain, actor, contract, path.stem)
        require_same_answers(load_checkpoint(plain), probes, actor.answer(probes))
        if contract.live_inputs:  # nobody here can make them: no golden vectors
            stamp(plain, path, overwrite=True)
            return path
        np.savez_compressed(trace, **_training_run(scenario, actor))  # type: ignore[arg-type]
        motion = motion_file(scenario.motion, Path(folder))
        stamp(plain, path, description=scenario.description, trace=trace, motion=motion, overwrite=True)
    return path


def write_network(path: Path, actor: Actor, contract: PolicyContract, name: str) -> None:
    """Write a policy that describes itself, from `obs` (B, N) to `actions` (B, m), without golden vectors."""
    import torch  # noqa: PLC0415 - whoever has an actor has it

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # PyTorch prefers its other exporter, which takes ten times as long
        torch.onnx.export(
            copy.deepcopy(actor.network).cpu().eval(),
            (torch.zeros(1, actor.widths[0]),),
            str(path),
            input_names=["obs"],
            output_names=["actions"],
            dynamic_axes={"obs": {0: "batch"}, "actions": {0: "batch"}},
            opset_version=_OPSET,
            dynamo=False,
        )
    model = onnx.load(str(path))
    model.graph.name, model.producer_name = name, "humanoid_sim.training"
    contract = replace(contract, tensors=TensorNames())  # of the model that the contract was taken from
    onnx.helper.set_model_props(model, {**write_metadata(contract), STAMP_KEY: encode(contract)})
    onnx.save(model, str(path))


def require_same_answers(checkpoint: Checkpoint, observations: Float32Array, expected: Float32Array) -> None:
    """Compare the checkpoint's actions on observations (k, N) with those of the network, (k, m).

    Raises `HumanoidSimError`, for a defect of the export, if they differ.
    """
    actual = np.array([checkpoint.policy(observation, 0) for observation in observations])
    worst = float((np.abs(actual - expected) / np.maximum(np.abs(expected), 1.0)).max())
    if not worst <= _TOLERANCE:
        raise HumanoidSimError(f"{checkpoint.source}: its actions differ from the network's by up to {worst:g}")


def motion_file(motion: Motions | None, folder: Path) -> Path | None:
    """Return a motion's file, of several the first; one without a file is written into `folder`. None: no motion.

    Raises `InputError` if it cannot be written.
    """
    first = motion[0] if isinstance(motion, list | tuple) else motion
    if first is None or isinstance(first, str | Path):
        return None if first is None else motion_path(str(first))
    assert isinstance(first, Motion)
    path = folder / "motion.mcap"
    write_motion(path, first)
    return path


def _environment(envs: Any) -> PolicyEnv | PolicyVectorEnv:
    """Return what is inside the libraries' and Gymnasium's wrappers.

    Raises `InputError` if it is not an environment of a policy, or a wrapper changes what the policy sees or commands.
    """
    inner = envs
    while not isinstance(inner, PolicyEnv | PolicyVectorEnv):
        if isinstance(inner, _CHANGING):
            raise InputError(
                f"envs: {type(inner).__name__} changes observations or actions, which the file would not; train "
                "without it: stable-baselines3's VecNormalize and rsl_rl's obs_normalization go into the file"
            )
        own = getattr(inner, "__dict__", {})
        inner = next((own[name] for name in _INSIDE if name in own), None)
        if isinstance(inner, list | tuple):
            inner = next(iter(inner), None)  # of several environments the first
        if inner is None:
            raise InputError(f"envs: is a {type(envs).__name__}, expected the environments that the policy learned in")
    return inner


def _training_run(scenario: Scenario, actor: Actor) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays of a trace, as `docs/golden-vectors.md` lists them, one row per policy step.

    The actions are the library's own, not those of the exported file. The run ends early where the robot is no longer
    sound. Raises `InputError` if the policy's first action would be refused on any robot.
    """
    actuation = "implicit" if scenario.actuation == "implicit" else "affine"
    options = scenario.robot_options() | {"actuation": actuation, "terrain": None}
    simulation = BatchSimulation(scenario.description, 1, **options, threads=1)
    start = scenario.task.start(np.random.default_rng(0).random((1, scenario.task.draws)))
    moving = np.linalg.norm(start.commands[0], axis=1)
    command = start.commands[:, int(np.argmax(moving))]  # of a policy that walks, one that is not to stand
    rows: list[dict[str, npt.NDArray[Any]]] = []
    with closing(simulation):
        simulation.reset(
            joint_position=start.joint_position, joint_velocity=start.joint_velocity, base_yaw=start.base_yaw
        )
        loop = ClosedLoop(simulation, scenario.wiring, command, scenario.live)
        for _ in range(min(_STEPS, scenario.task.episode_steps)):
            observation, state = loop.observation.copy(), loop.state
            action = actor.answer(observation)
            if not (np.isfinite(observation).all() and loop.wiring.accepts(action).all()):
                break
            row: dict[str, Any] = {name: getattr(state, name) for name in STATE_ARRAYS}
            row |= {name: extern.value for name, extern in state.extern.items()}
            row |= {"observation": observation, "action": action, "target": loop.act(action).position}
            rows.append({name: np.array(value[0]) for name, value in row.items()})
            if simulation.fault.any():
                break
    if not rows:
        raise InputError(
            "the policy's first action is one that no controller accepts; train on, or with another --seed"
        )
    names = np.array(scenario.description.joint_names)
    return {name: np.stack([row[name] for row in rows]) for name in rows[0]} | {"joint_names": names}
