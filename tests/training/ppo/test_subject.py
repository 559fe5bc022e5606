import gymnasium
import numpy as np
import pytest

from humanoid_sim.assets import motion_path
from humanoid_sim.errors import InputError
from humanoid_sim.policy.motion import read_motion
from humanoid_sim.training.ppo.environment import subject_of
from humanoid_sim.training.ppo.export import motion_file
from humanoid_sim.training.ppo.learner import first_spread
from humanoid_sim.training.ppo.options import TrainConfig


def test_a_robot_alone_is_trained_for_what_its_policy_does():
    arms = subject_of(TrainConfig())
    assert (arms.task, arms.told["contract"], arms.told["motion"]) == ("tracking", "lite_tracking", "wave")
    legs = subject_of(TrainConfig(robot="lite_biped"))
    assert (legs.task, legs.told["contract"], legs.told["motion"]) == ("velocity", "lite_biped_velocity", None)
    assert legs.contract.phase is not None
    assert subject_of(TrainConfig(robot="lite_biped", task="walking")).task == "walking"
    # 0.2 rad of 0.5 rad per unit of action, and 0.1 rad of 0.25
    assert first_spread(arms.contract, is_floating=False) == pytest.approx(0.4)
    assert first_spread(legs.contract, is_floating=True) == pytest.approx(0.4)


def test_the_environments_are_those_of_the_options():
    envs = subject_of(TrainConfig(actuation="implicit", physics_timestep=0.005)).environments(2)
    assert (envs.scenario.actuation, envs.scenario.physics_timestep) == ("implicit", 0.005)
    assert envs.metadata["autoreset_mode"] is gymnasium.vector.AutoresetMode.SAME_STEP
    plain = gymnasium.make_vec(
        "humanoid_sim/LiteTracking-v0",
        num_envs=2,
        actuation="implicit",
        physics_timestep=0.005,
        autoreset_mode="SameStep",
    )
    np.testing.assert_array_equal(envs.reset(seed=3)[0], plain.reset(seed=3)[0])
    action = np.full((2, 14), 0.1, dtype=np.float32)
    np.testing.assert_array_equal(envs.step(action)[0], plain.step(action)[0])
    envs.close()
    plain.close()


def test_what_the_critic_sees_is_rsl_rls_affair():
    subject = subject_of(TrainConfig(algorithm="ppo-rsl_rl", privileged=("joint_torque",)))
    envs = subject.environments(1)
    assert envs.reset(seed=0)[1]["privileged"].shape == (1, 14)
    envs.close()
    with pytest.raises(InputError, match=r"^--privileged: base_height is of a floating base"):
        subject_of(TrainConfig(algorithm="ppo-rsl_rl", privileged=("base_height",)))


def test_ground_motions_and_starts_reach_the_environments():
    walking = subject_of(TrainConfig(robot="lite_biped", terrain="steps"))
    assert walking.scenario.terrain is not None
    assert walking.told["terrain"]["kind"] == "steps"
    several = subject_of(TrainConfig(motion=("wave", "circle"), reference_start=0.8))
    starts = several.scenario.starts
    assert (len(starts.reference.lengths), starts.reference_start) == (2, 0.8)
    alone = several.environment()  # to be looked at: from the beginning
    assert alone.scenario.starts.reference_start == 0.0
    alone.close()


def test_a_song_is_the_motion_of_the_piano(tmp_path):
    subject = subject_of(TrainConfig(robot="lite_piano", motion=("twinkle",)))
    assert (subject.task, subject.told["motion"]) == ("piano", "twinkle")
    file = motion_file(subject.scenario.motion, tmp_path)
    assert file == tmp_path / "motion.mcap"
    song = read_motion(file)
    assert (song.task_type, song.frames.shape[1]) == ("piano", 88)
    assert len(song.frames) == subject.scenario.wiring.reference.frame_count
    arms = subject_of(TrainConfig(motion=("circle", "wave")))
    assert motion_file(arms.scenario.motion, tmp_path) == motion_path("circle")
    assert motion_file(subject_of(TrainConfig(robot="lite_biped")).scenario.motion, tmp_path) is None
