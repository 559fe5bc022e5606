"""Train, export and record with mjlab, in an environment of its own: `mjlab_exports.py FOLDER`.

For each task, FOLDER/<name> holds what mjlab's own exporter wrote, and in `golden` what the example wrote that records
mjlab; FOLDER/rsl_rl holds a policy that rsl_rl exported. Training lasts one iteration: the networks have learnt
nothing, and only their wiring counts.
"""

import importlib.util
import os
import shutil
import sys
from pathlib import Path

import mjlab.tasks  # noqa: F401 - registers the tasks
import numpy as np
from mjlab.scripts import csv_to_npz
from mjlab.scripts.train import TrainConfig, run_train
from rsl_rl.runners import OnPolicyRunner

TASKS = {
    "velocity_flat": "Mjlab-Velocity-Flat-Unitree-G1",
    "velocity_rough": "Mjlab-Velocity-Rough-Unitree-G1",
    "tracking": "Mjlab-Tracking-Flat-Unitree-G1",
    "tracking_no_state_estimation": "Mjlab-Tracking-Flat-Unitree-G1-No-State-Estimation",
}
STEPS = 60
SEED = 8
"""Of the recording; with this one the ground of the rough task is uneven where the robot stands."""
JOINTS = 29
MOTION_FPS, MOTION_SECONDS = 50, 4.0
RECORDER = Path(__file__).parents[2] / "examples" / "mjlab_trace.py"


def make_motion(output):
    """Make a motion of the G1 in which every joint and the base move, with mjlab's own converter."""
    os.environ["WANDB_MODE"] = "disabled"  # it uploads what it makes
    time = np.arange(0.0, MOTION_SECONDS, 1.0 / MOTION_FPS)
    turn = 0.3 * np.sin(1.5 * time)  # rad, about the vertical
    base = [0.1 * np.sin(time), 0.05 * np.sin(2.0 * time), 0.78 + 0.0 * time]
    base += [0.0 * time, 0.0 * time, np.sin(turn / 2.0), np.cos(turn / 2.0)]
    joints = [0.1 * np.sin((1.0 + 0.1 * joint) * time) for joint in range(JOINTS)]
    csv, made = output.with_suffix(".csv"), Path("/tmp/motion.npz")  # where the converter writes, whatever it is told
    np.savetxt(csv, np.column_stack([*base, *joints]), delimiter=",")
    made.unlink(missing_ok=True)
    csv_to_npz.main(str(csv), "motion", input_fps=MOTION_FPS, output_fps=MOTION_FPS, device="cpu")
    shutil.move(made, output)


def train(task, folder, motion):
    """Train for one iteration; mjlab's runner exports the policy with each checkpoint."""
    config = TrainConfig.from_task(task)
    config.env.scene.num_envs = 4
    config.agent.max_iterations, config.agent.logger = 1, "tensorboard"
    if config.env.scene.terrain.terrain_generator is not None:
        config.env.scene.terrain.terrain_generator.num_rows = 2
        config.env.scene.terrain.terrain_generator.num_cols = 2
    if "motion" in config.env.commands:
        config.env.commands["motion"].motion_file = str(motion)
    run_train(task, config, folder)


def export_with_rsl_rl(recorder, task, checkpoint, folder):
    """Export the same network as rsl_rl does without mjlab: no metadata, PyTorch's new exporter."""
    env, runner = recorder.load(task, checkpoint, recorder.configuration(task, None, SEED))
    OnPolicyRunner.export_policy_to_onnx(runner, str(folder), "policy.onnx")
    env.close()


def main(folder):
    """Make everything."""
    os.environ["CUDA_VISIBLE_DEVICES"] = ""
    spec = importlib.util.spec_from_file_location("mjlab_trace", RECORDER)
    recorder = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(recorder)
    folder.mkdir(parents=True, exist_ok=True)
    motion = folder / "motion.npz"
    make_motion(motion)
    for name, task in TASKS.items():
        made = folder / name
        train(task, made, motion)
        checkpoint = max(made.glob("model_*.pt"))
        options = ["--motion", str(motion)] if name.startswith("tracking") else []
        options += ["--steps", str(STEPS), "--seed", str(SEED), "--output", str(made / "golden")]
        recorder.main([task, str(checkpoint), *options])
        if name == "velocity_flat":
            export_with_rsl_rl(recorder, task, checkpoint, folder / "rsl_rl")


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
