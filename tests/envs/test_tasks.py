import gymnasium
import numpy as np
import pytest

from humanoid_sim.assets import motion_path
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.reference import MotionReference, build_reference, build_world_reference, no_reference
from humanoid_sim.controllers.rotation import multiply, rotate
from humanoid_sim.envs.tasks import TASKS, make_task
from humanoid_sim.envs.tasks.task import BalanceTask
from humanoid_sim.envs.tasks.tracking import MotionTask, TrackingTask
from humanoid_sim.envs.tasks.velocity import VelocityTask
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.errors import total
from humanoid_sim.evaluation.rollout import StepSample
from humanoid_sim.mit import ANCHOR_POSE, Extern, MITState
from humanoid_sim.policy.motion import read_motion
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.floating_base import BaseState

DT = 0.02
BODIES = ("left_hand", "right_hand")
HALF_TURN = np.sqrt(0.5)


def contract_of(robot, task, **changes):
    names = robot.joint_names
    fields = {
        "task_type": task,
        "joint_names": names[::-1],  # another order than the robot's
        "action_joint_names": names[::-1],
        "joint_stiffness": robot.stiffness,
        "joint_damping": robot.damping,
        "default_joint_pos": np.array(robot.standby_controller_a.pose_segments[-1])[::-1],
        "observation": ("joint_pos", "joint_vel", "actions"),
        "command_names": (),
        "action_scale": np.ones(len(names)),
        "policy_dt": DT,
        "body_names": BODIES if task == "tracking" else (),
    }
    return PolicyContract(**{**fields, **changes})


@pytest.fixture(scope="module")
def lite():
    return load_robot("lite")


@pytest.fixture(scope="module")
def biped():
    return load_robot("lite_biped")


def two_body_frames(count):
    """The left hand is 0.1 m further ahead in every frame, the right hand stays at the origin, turned left by 90°."""
    frames = np.zeros((count, 18))
    frames[:, 0] = 0.1 * np.arange(count)
    frames[:, 6:12] = [1.0, 0.0, 0.0, 1.0, 0.0, 0.0]
    frames[:, 12:18] = [0.0, -1.0, 1.0, 0.0, 0.0, 0.0]
    return frames


@pytest.fixture(scope="module")
def tracking(lite):
    contract = contract_of(lite, "tracking")
    return TrackingTask(lite, contract, build_reference(contract, two_body_frames(4)))


@pytest.fixture(scope="module")
def velocity(biped):
    contract = contract_of(biped, "locomotion")
    return VelocityTask(biped, contract, no_reference(), standing_height=1.0, episode_seconds=12.0)


def state(joint_position, **extern):
    batch, zeros = joint_position.shape[:-1], np.zeros_like(joint_position)
    live = {name: Extern(value, 0.0) for name, value in extern.items()}
    quaternion = np.broadcast_to([1.0, 0.0, 0.0, 0.0], (*batch, 4))
    vector = np.zeros((*batch, 3))
    return MITState(0.0, joint_position, zeros, zeros, zeros, quaternion, vector, vector, live)


def state_of_base(position, quaternion, linear, angular):
    """With the centre of mass at the base's origin, on a floor at 0."""
    return BaseState(position, quaternion, linear, angular, position, np.zeros(position.shape[:-1]))


def sample(task, batch=(), **changes):
    """The robot at rest in its default pose, its bodies exactly on frame 0 of `two_body_frames`."""
    n, m = len(task.contract.joint_names), task.contract.action_count
    pose = task.start(np.full((*batch, task.draws), 0.5)).joint_position
    quaternions = np.broadcast_to([[1.0, 0.0, 0.0, 0.0], [HALF_TURN, 0.0, 0.0, HALF_TURN]], (*batch, 2, 4))
    upright = np.broadcast_to([1.0, 0.0, 0.0, 0.0], (*batch, 4))
    height = np.broadcast_to([0.0, 0.0, 1.0], (*batch, 3))
    fields = {
        "state": state(pose),
        "action": np.zeros((*batch, m), dtype=np.float32),
        "previous_action": np.zeros((*batch, m), dtype=np.float32),
        "torque": np.zeros((*batch, n)),
        "frame": np.zeros(batch, dtype=np.int64) if batch else 0,
        "step": np.ones(batch, dtype=np.int64) if batch else 1,
        "body_position": np.zeros((*batch, 2, 3)),
        "body_quaternion": quaternions,
        "command": np.zeros((*batch, 3)),
        "base": state_of_base(height, upright, np.zeros((*batch, 3)), np.zeros((*batch, 3))),
    }
    return StepSample(**{**fields, **changes})


def test_perfect_tracking_earns_the_weights_per_second(tracking):
    judgement = tracking.judge(sample(tracking))
    assert judgement.terms["body_position"] == pytest.approx(1.0 * DT)
    assert judgement.terms["body_orientation"] == pytest.approx(0.5 * DT)
    assert judgement.reward == pytest.approx(1.5 * DT)
    assert not judgement.terminated
    assert not judgement.truncated


def test_tracking_errors_are_against_the_sample_s_frame(tracking):
    errors = tracking.position_error(np.zeros((2, 3)), 2)
    np.testing.assert_allclose(errors, [0.2, 0.0], atol=1e-7)  # the reference is float32
    assert tracking.judge(sample(tracking, frame=1)).terms["body_position"] == pytest.approx(
        DT * np.exp(-0.5 * 0.1**2 / 0.1**2), rel=1e-6
    )
    assert not tracking.judge(sample(tracking, frame=2)).terminated
    assert tracking.judge(sample(tracking, frame=2, body_position=np.full((2, 3), -0.2))).terminated
    assert tracking.judge(sample(tracking, body_position=np.full((2, 3), np.nan))).terminated


@pytest.mark.parametrize("angle", [1e-9, 1e-3, 1.0, 3.0, np.pi])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_orientation_error_is_the_angle_for_either_sign_of_the_quaternion(tracking, angle, sign):
    axis = np.array([0.6, 0.0, 0.8])
    turned = sign * np.array([np.cos(angle / 2), *(np.sin(angle / 2) * axis)])
    right = multiply(np.array([HALF_TURN, 0.0, 0.0, HALF_TURN]), turned)
    errors = tracking.orientation_error(np.stack([turned, right]), 0)
    np.testing.assert_allclose(errors, [angle, angle], rtol=1e-6, atol=1e-7)


def test_effort_action_rate_and_joint_stops_cost(tracking, lite):
    torque = np.zeros(14)
    torque[0], torque[4] = lite.effort_limit[0], -0.5 * lite.effort_limit[4]
    action = np.zeros(14, dtype=np.float32)
    action[:2] = (1.0, -2.0)
    position = np.array(sample(tracking).state.joint_position)
    position[3] = lite.upper[3] + 0.01
    terms = tracking.judge(sample(tracking, torque=torque, action=action, state=state(position))).terms
    assert terms["effort"] == pytest.approx(-0.05 * 1.25 * DT)
    assert terms["action_rate"] == pytest.approx(-0.02 * 5.0 * DT)
    assert terms["joint_stops"] == pytest.approx(-2.0 * 0.06 * DT)


def test_weights_are_the_user_s_and_strangers_are_refused(lite):
    contract = contract_of(lite, "tracking")
    reference = build_reference(contract, two_body_frames(4))
    task = TrackingTask(lite, contract, reference, weights={"body_position": 3.0})
    assert task.judge(sample(task)).terms["body_position"] == pytest.approx(3.0 * DT)
    with pytest.raises(InputError, match=r"unknown reward term 'speed'; known: body_position, body_orientation, "):
        TrackingTask(lite, contract, reference, weights={"speed": 1.0})
    with pytest.raises(InputError, match="weights: effort is nan"):
        TrackingTask(lite, contract, reference, weights={"effort": float("nan")})
    with pytest.raises(InputError, match="joint_noise: is -1"):
        TrackingTask(lite, contract, reference, joint_noise=-1.0)


def test_starts_are_around_the_default_pose_in_the_robot_s_order(tracking, lite):
    start = tracking.start(np.random.default_rng(3).random((500, tracking.draws)))
    assert start.joint_position.shape == (500, 14)
    offset = start.joint_position - np.array(lite.standby_controller_a.pose_segments[-1])
    assert np.abs(offset).max() <= 0.05 + 1e-12
    assert np.abs(offset).max(axis=0).min() > 0.04  # every joint moves
    assert np.abs(start.joint_velocity).max() == pytest.approx(0.1, rel=0.02)
    assert (start.base_yaw == 0.0).all()
    assert start.commands.shape == (500, 1, 3)


def test_a_user_s_terms_are_added_or_replace_the_task_s(lite):
    def height(sample):
        return sample.state.joint_position[..., 3]

    rewards = {"elbow": (2.0, height), "effort": (-1.0, lambda sample: total(np.abs(sample.torque)))}
    options = {"robot": lite, "rewards": rewards, "weights": {"elbow": 4.0}}
    single = gymnasium.make("humanoid_sim/LiteTracking-v0", **options)
    vector = gymnasium.make_vec("humanoid_sim/LiteTracking-v0", num_envs=2, threads=1, **options)
    single.reset(seed=5)
    vector.reset(seed=4)
    action = np.full((2, 14), 0.3, dtype=np.float32)
    terms = single.step(action[1])[4]["terms"]
    batch = vector.step(action)[4]["terms"]
    state = single.unwrapped.robot.truth()
    assert terms["elbow"] == pytest.approx(4.0 * 0.02 * state.joint_position[3])
    assert terms["effort"] < -0.02
    for name in ("elbow", "effort", "body_position"):
        assert batch[name][1] == pytest.approx(float(terms[name]), abs=1e-9)


def test_walking_at_the_command_earns_the_weights_per_second(velocity):
    quaternion = np.array([np.cos(0.5), 0.0, 0.0, np.sin(0.5)])  # turned left by 1 rad
    base = state_of_base(
        np.array([5.0, 2.0, 1.0]), quaternion, rotate(quaternion, np.array([0.4, 0.1, 0.0])), np.array([0.0, 0.0, 0.3])
    )
    exact = velocity.judge(sample(velocity, base=base, command=np.array([0.4, 0.1, 0.3])))
    assert exact.reward == pytest.approx((1.0 + 0.5 + 0.5) * DT)
    slow = velocity.judge(sample(velocity, base=base, command=np.array([0.4, 0.35, 0.8])))
    assert slow.terms["linear_velocity"] == pytest.approx(DT * np.exp(-1.0))
    assert slow.terms["yaw_rate"] == pytest.approx(0.5 * DT * np.exp(-1.0))


def test_a_fall_is_a_tilt_or_a_low_base(velocity):
    zeros = np.zeros((4, 3))
    position = np.array([[0.0, 0.0, 1.0]] * 3 + [[0.0, 0.0, 0.59]])
    tilt = np.array([0.0, 0.9, 1.1, 0.0])
    quaternion = np.stack([np.cos(tilt / 2), np.sin(tilt / 2), np.zeros(4), np.zeros(4)], axis=-1)
    judgement = velocity.judge(sample(velocity, (4,), base=state_of_base(position, quaternion, zeros, zeros)))
    np.testing.assert_array_equal(judgement.terminated, [False, False, True, True])
    np.testing.assert_allclose(judgement.terms["upright"], -DT * np.sin(tilt) ** 2, atol=1e-15)


def test_following_a_whole_body_motion(biped):
    names = biped.joint_names
    contract = contract_of(biped, "tracking", anchor_body="pelvis", body_names=("pelvis",))
    frames = np.zeros((3, 2 * 14 + 7))
    frames[:, :14], frames[:, 28:31], frames[:, 31] = biped.initial_position, [0.0, 0.0, 1.0], 1.0
    frames[:, 28] = [0.0, 0.3, 0.6]
    reference = build_world_reference(contract, frames, names, ("pelvis",))
    task = MotionTask(biped, contract, reference)

    def at(frame, pose, **changes):
        position = np.array(biped.initial_position)
        return sample(task, frame=frame, state=state(position, **{ANCHOR_POSE: np.array(pose)}), **changes)

    assert task.judge(at(0, [0, 0, 1, 1, 0, 0, 0])).reward == pytest.approx(2.0 * DT, rel=1e-6)
    behind = task.judge(at(1, [0, 0, 1, 1, 0, 0, 0]))
    assert behind.terms["anchor_position"] == pytest.approx(0.5 * DT * np.exp(-1.0), rel=1e-6)
    assert not behind.terminated
    assert task.judge(at(0, [0, 0, 0.64, 1, 0, 0, 0])).terminated
    assert not task.judge(at(0, [0, 0, 1, np.cos(0.7), 0, 0, np.sin(0.7)])).terminated  # the heading alone
    assert task.judge(at(0, [0, 0, 1, np.cos(0.7), np.sin(0.7), 0, 0])).terminated
    assert [bool(task.judge(at(frame, [0, 0, 1, 1, 0, 0, 0])).truncated) for frame in (1, 2)] == [False, True]


@pytest.mark.parametrize("name", ["tracking", "velocity"])
def test_a_batch_gives_bit_for_bit_what_its_robots_give(name, request):
    task = request.getfixturevalue(name)
    n, rng = 14, np.random.default_rng(7)
    quaternion = rng.normal(size=(5, 4))
    quaternion /= np.sqrt((quaternion**2).sum(axis=-1, keepdims=True))
    arrays = {
        "action": rng.normal(size=(5, n)).astype(np.float32),
        "previous_action": rng.normal(size=(5, n)).astype(np.float32),
        "torque": rng.normal(size=(5, n)),
        "frame": np.array([0, 1, 2, 3, 9]),
        "step": np.array([1, 2, 3, 600, 7]),
        "body_position": 0.1 * rng.normal(size=(5, 2, 3)),
        "body_quaternion": np.stack([quaternion, quaternion[::-1]], axis=1),
        "command": rng.normal(size=(5, 3)),
    }
    position, motion = 3.0 * rng.normal(size=(5, n)), rng.normal(size=(3, 5, 3))
    batch = task.judge(
        sample(task, (5,), **arrays, state=state(position), base=state_of_base(motion[0], quaternion, *motion[1:]))
    )
    for i in range(5):
        base = state_of_base(motion[0, i], quaternion[i], *motion[1:, i])
        one = task.judge(
            sample(task, **{key: value[i] for key, value in arrays.items()}, state=state(position[i]), base=base)
        )
        assert one.reward == batch.reward[i]
        assert {key: value.item() for key, value in one.terms.items()} == {
            key: value[i] for key, value in batch.terms.items()
        }
        assert (one.terminated, one.truncated) == (batch.terminated[i], batch.truncated[i])
    numbers = rng.random((5, task.draws))
    np.testing.assert_array_equal(task.start(numbers[2]).commands, task.start(numbers).commands[2])
    np.testing.assert_array_equal(task.start(numbers[2]).joint_position, task.start(numbers).joint_position[2])


def test_the_task_that_a_contract_was_made_for(lite, biped):
    wave = read_motion(motion_path("wave"))
    tracked = contract_of(lite, "tracking", body_names=wave.body_names)
    reference = build_reference(tracked, wave.frames)
    assert isinstance(make_task("auto", lite, tracked, reference), TrackingTask)
    assert isinstance(make_task("auto", biped, contract_of(biped, "locomotion"), no_reference()), VelocityTask)
    assert isinstance(make_task("auto", lite, contract_of(lite, "locomotion"), no_reference()), BalanceTask)
    joints = MotionReference(2, {"reference_joint_pos": np.zeros((2, 14)), "reference_joint_vel": np.zeros((2, 14))})
    assert isinstance(make_task("auto", lite, tracked, joints), MotionTask)
    assert isinstance(make_task("balance", lite, tracked, reference), BalanceTask)


def test_tasks_that_do_not_fit_are_refused(lite):
    contract = contract_of(lite, "locomotion")
    with pytest.raises(InputError, match=f"unknown task 'dance'; known: auto, {', '.join(TASKS)}"):
        make_task("dance", lite, contract, no_reference())
    with pytest.raises(InputError, match="tracking needs a motion with motion_body_pos_b"):
        make_task("tracking", lite, contract, no_reference())
    with pytest.raises(InputError, match="lite: has a fixed base, expected a floating one"):
        make_task("velocity", lite, contract, no_reference())
