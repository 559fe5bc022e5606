"""Record golden vectors of a policy that mjlab trained, in mjlab's own environment.

    python mjlab_trace.py Mjlab-Velocity-Flat-Unitree-G1 logs/rsl_rl/g1_velocity/RUN/model_29999.pt --output golden
    python -m humanoid_sim.policy stamp logs/rsl_rl/g1_velocity/RUN/RUN.onnx --output stamped.onnx \
        --robot golden/scene.xml --contract golden/contract.yaml --trace golden/trace.npz

Needs NumPy and mjlab (1.6) alone. The environment is the task's play configuration, without noise and terminations; of
its events only those at a reset remain, because the robot's sensors do not report a random mass or encoder offset.
"""

import argparse
import json
import shutil
from dataclasses import asdict
from pathlib import Path

import mjlab.tasks  # noqa: F401 - registers the tasks
import mujoco
import numpy as np
from mjlab.envs import ManagerBasedRlEnv
from mjlab.rl import MjlabOnPolicyRunner, RslRlVecEnvWrapper
from mjlab.scene import Scene
from mjlab.tasks.registry import list_tasks, load_env_cfg, load_rl_cfg, load_runner_cls


def configuration(task, motion, seed):
    """Return the configuration of the task with one robot; `motion` is the file that a tracking task follows."""
    cfg = load_env_cfg(task, play=True)
    cfg.scene.num_envs, cfg.seed = 1, seed
    cfg.events = {name: event for name, event in cfg.events.items() if event.mode == "reset"}
    cfg.terminations = {}
    cfg.observations["actor"].enable_corruption = False
    for command in cfg.commands.values():
        if hasattr(command, "motion_file"):
            command.motion_file = str(motion)
        else:  # several directions: a value that is always zero shows neither its scale nor its sign
            command.resampling_time_range = (0.1, 0.3)
    ground = cfg.scene.terrain
    if ground is not None and ground.terrain_generator is not None:
        ground.terrain_generator.seed = seed  # write_scene writes the ground of the trace
    return cfg


def write_scene(scene, folder):
    """Write the robot on its ground as MJCF, with the robot's meshes, which mjlab's own export omits."""
    Scene(scene, device="cpu").write(folder)
    robot = scene.entities["robot"].spec_fn()
    shutil.copytree(Path(robot.modelfiledir, robot.meshdir), folder / "assets", dirs_exist_ok=True)


def write_contract(env, file):
    """Write what mjlab's export leaves out or rounds to three decimals; JSON is YAML, too."""
    robot, model = env.scene["robot"], env.sim.mj_model
    action = env.action_manager.get_term("joint_pos")
    joints, drives = robot.indexing.joint_ids.tolist(), model.actuator_trnid[:, 0].tolist()
    actuators = [drives.index(joint) for joint in joints]
    values = {
        "policy_dt": env.step_dt,
        "default_joint_pos": robot.data.default_joint_pos[0].tolist(),
        "joint_stiffness": model.actuator_gainprm[actuators, 0].tolist(),
        "joint_damping": (-model.actuator_biasprm[actuators, 2]).tolist(),
        "effort_limit": model.actuator_forcerange[actuators, 1].tolist(),
        "action_scale": action.scale if isinstance(action.scale, float) else action.scale[0].tolist(),
    }
    file.write_text("\n".join(f"{name}: {json.dumps(value)}" for name, value in values.items()) + "\n")


def record(env, policy, steps):
    """Return one row per policy step, with the state from which its observation was made."""
    inner = env.unwrapped
    robot, data, places = inner.scene["robot"], inner.sim.data, inner.scene["robot"].indexing
    qpos = [*places.free_joint_q_adr.tolist(), *places.joint_q_adr.tolist()]
    qvel = [*places.free_joint_v_adr.tolist(), *places.joint_v_adr.tolist()]
    observation, _ = env.reset()
    rows = []
    for _ in range(steps):
        action = policy(observation).detach()
        row = {"obs": observation["actor"], "action": action, "qpos": data.qpos[:, qpos], "qvel": data.qvel[:, qvel]}
        for name in inner.command_manager.active_terms:
            command = inner.command_manager.get_term(name)
            if hasattr(command, "motion"):
                row["frame"] = command.time_steps
                row["alignment"] = data.qpos.new_tensor([[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]])  # one world
            else:
                row["cmd"] = command.command
        if "height_scan" in inner.observation_manager.active_terms["actor"]:
            term = inner.observation_manager.get_term_cfg("actor", "height_scan")
            row["height_scan"] = term.func(inner, **term.params)  # m, before clip and scale
        rows.append({name: value[0].cpu().numpy().copy() for name, value in row.items()})
        observation, *_ = env.step(action)
        rows[-1]["target"] = robot.data.joint_pos_target[0].cpu().numpy().copy()
    table = {name: np.stack([row[name] for row in rows]) for name in rows[0]}
    versions = {"mujoco_version": np.array(mujoco.__version__)}
    return {"joint_names": np.array(robot.joint_names), **versions, **table}


def load(task, checkpoint, cfg):
    """Return environment and runner of a checkpoint, as mjlab's `play` makes them."""
    agent = load_rl_cfg(task)
    env = RslRlVecEnvWrapper(ManagerBasedRlEnv(cfg, device="cpu"), clip_actions=agent.clip_actions)
    runner = (load_runner_cls(task) or MjlabOnPolicyRunner)(env, asdict(agent), device="cpu")
    runner.load(str(checkpoint), load_cfg={"actor": True}, map_location="cpu")
    return env, runner


def main(arguments=None):
    """Write the folder."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("task", choices=list_tasks(), metavar="TASK", help="as mjlab's list-envs shows it")
    parser.add_argument("checkpoint", type=Path, help="model_*.pt of the run")
    parser.add_argument("--motion", type=Path, help="motion.npz, which a tracking task follows")
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0, help="of the commands, the start and the ground")
    parser.add_argument("--output", type=Path, default=Path("golden"), help="folder for trace, contract and scene")
    options = parser.parse_args(arguments)
    cfg = configuration(options.task, options.motion, options.seed)
    if any(hasattr(command, "motion_file") for command in cfg.commands.values()) and options.motion is None:
        parser.error(f"{options.task} follows a motion: --motion FILE is missing")
    env, runner = load(options.task, options.checkpoint, cfg)
    trace = record(env, runner.get_inference_policy(device="cpu"), options.steps)
    write_scene(cfg.scene, options.output)
    write_contract(env.unwrapped, options.output / "contract.yaml")
    np.savez(options.output / "trace.npz", **trace)
    print(f"{options.output}: {len(trace['obs'])} steps")
    env.close()


if __name__ == "__main__":
    main()
