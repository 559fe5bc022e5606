import numpy as np
import pytest
from drive import Drive

from humanoid_sim.assets import SAMPLE_POLICY, asset_path
from humanoid_sim.evaluation.tracking import TrackingErrors
from humanoid_sim.messages import Intent, Mode
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.loaded_policy import load_policy
from humanoid_sim.policy.motion import read_motion

MOTIONS = sorted(path.stem for path in asset_path("motions").glob("*.mcap"))


def test_there_are_motions():
    assert {"wave", "circle", "reach"} <= set(MOTIONS)


@pytest.mark.parametrize("name", MOTIONS)
def test_the_sample_policy_tracks_the_sample_motions(name):
    checkpoint = load_checkpoint(SAMPLE_POLICY)
    motion = read_motion(asset_path("motions", f"{name}.mcap"))
    drive = Drive(load_policy(checkpoint.contract, checkpoint.policy, motion, checkpoint.observation_width))
    errors = TrackingErrors(drive.description, motion.frames, motion.body_names, motion.policy_dt)
    drive.stand()
    drive.step(Intent.START_LOCOMOTION)
    drive.run(motion.duration)
    frames = []
    for state, output in zip(drive.states, drive.outputs, strict=True):
        if output.policy_step is not None:
            frames.append(output.policy_step.frame)
            errors.update(output.policy_step.frame, state.joint_position)
    assert frames == list(range(len(motion.frames)))
    assert drive.outputs[-1].control_mode.mode is Mode.LOCOMOTION
    summary = errors.summary()
    assert summary.peak_speed >= 0.5  # m/s
    assert summary.hands.position_rms <= 0.03
    assert summary.hands.orientation_rms <= np.radians(12.0)
    assert np.abs(drive.applied()).max() < drive.description.effort_limit.max()


def test_at_the_end_of_the_motion_the_last_frame_is_held():
    checkpoint = load_checkpoint(SAMPLE_POLICY)
    motion = read_motion(asset_path("motions", "reach.mcap"))
    drive = Drive(load_policy(checkpoint.contract, checkpoint.policy, motion))
    drive.stand()
    drive.step(Intent.START_LOCOMOTION)
    drive.run(motion.duration + 1.0)
    last = [output.policy_step.frame for output in drive.outputs if output.policy_step][-50:]
    assert last == [len(motion.frames) - 1] * 50
    assert np.abs(drive.states[-1].joint_velocity).max() < 0.05
