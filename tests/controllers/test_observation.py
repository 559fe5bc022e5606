"""The observation: values and conventions of its terms, terms without a source, and the motions that they show."""

import numpy as np
import pytest
from rig import JOINTS, contract, reference, state

from humanoid_sim.controllers.contract import Term
from humanoid_sim.controllers.observation import pack, resolve_observation
from humanoid_sim.controllers.reference import build_reference, no_reference
from humanoid_sim.controllers.terms import TermInput
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import Extern

STATE = state(
    1.0,
    joint_velocity=[1.0, 2.0, 3.0],
    imu_quaternion=[0.8, 0.0, 0.0, 0.6],
    imu_angular_velocity=[5.0, 6.0, 7.0],
    imu_linear_acceleration=[8.0, 9.0, 10.0],
    extern={"foot_contact": Extern([11.0, 12.0], 1.0)},
)


@pytest.mark.parametrize(
    ("term", "values"),
    [
        ("joint_pos", [0.6 - 0.01, 0.5 - 0.02, 0.4 - 0.03]),
        (Term("joint_pos", relative=False), [0.6, 0.5, 0.4]),
        (Term("dof_pos", joints=("shoulder", "wrist")), [0.4 - 0.03, 0.6 - 0.01]),
        ("joint_vel", [3.0, 2.0, 1.0]),
        (Term("joint_vel", joints=("elbow",), scale=0.5), [1.0]),
        (Term("joint_vel", scale=0.0), [0.0, 0.0, 0.0]),
        (Term("joint_vel", clip=(-1.0, 2.5), scale=2.0), [5.0, 4.0, 2.0]),
        (Term("joint_vel", scale=[1.0, 10.0, 100.0]), [3.0, 20.0, 100.0]),
        (Term("actions", form="scaled"), [0.25, -0.125]),
        (Term("last_action"), [0.5, -0.5]),
        ("imu_quaternion", [0.8, 0.0, 0.0, 0.6]),
        (Term("imu_quaternion", quaternion="xyzw"), [0.0, 0.0, 0.6, 0.8]),
        (Term("base_ang_vel"), [5.0, 6.0, 7.0]),
        # Turned about the vertical by the angle whose half has the cosine 0.8 and the sine 0.6.
        (Term("base_ang_vel", frame="world"), [0.28 * 5 - 0.96 * 6, 0.96 * 5 + 0.28 * 6, 7.0]),
        (Term("projected_gravity", scale=-1.0), [0.0, 0.0, 1.0]),
        ("imu_linear_acceleration", [8.0, 9.0, 10.0]),
        ("foot_contact", [11.0, 12.0]),
    ],
    ids=lambda value: getattr(value, "name", ""),
)
def test_values_and_conventions_of_a_term(term, values):
    layout = resolve_observation(contract(observation=(term,)), JOINTS, reference(), {"foot_contact": 2})
    packed = pack(layout, TermInput(STATE, np.array([0.5, -0.5], np.float32), 2))
    assert packed.dtype == np.float32
    np.testing.assert_allclose(packed, values, rtol=1e-6, atol=1e-7)


def test_the_last_action_is_shown_as_it_was_clipped():
    layout = resolve_observation(contract(observation=("actions",), action_clip=0.4), JOINTS, reference(), {})
    now = TermInput(STATE, np.array([0.5, -0.5], np.float32), 2)
    assert pack(layout, now).tolist() == np.array([0.4, -0.4], np.float32).tolist()


@pytest.mark.parametrize(
    ("name", "source", "message"),
    [
        ("mood", reference(), "unknown observation term 'mood'"),
        ("motion_body_ori_b", reference(), "observation term 'motion_body_ori_b' needs a motion"),
        ("target_keys", reference(), "observation term 'target_keys' needs a motion with target_keys"),
        ("progress", no_reference(), "observation term 'progress' needs a motion, and there is none"),
    ],
)
def test_a_term_without_a_source_is_refused(name, source, message):
    with pytest.raises(FieldError, match=f"^{message}"):
        resolve_observation(contract(observation=(name,)), JOINTS, source, {})


def test_a_tracking_motion_is_cut_into_positions_and_orientations():
    two = contract(body_names=("left_hand", "right_hand"))
    motion = build_reference(two, np.arange(36.0).reshape(2, 18))
    assert motion.frame_count == 2
    assert motion.term("motion_body_pos_b", 0).tolist() == [0, 1, 2, 3, 4, 5]
    assert motion.term("motion_body_ori_b", 1).tolist() == list(range(24, 36))


def test_a_song_looks_ahead_and_holds_its_end():
    piano = contract(task_type="piano", observation=("target_keys",), lookahead_steps=(1, 2))
    song = build_reference(piano, [[0, 0], [1, 0], [0, 1]])
    assert song.term("target_keys", 1).tolist() == [1, 0]
    assert [song.term("target_keys_future", k).tolist() for k in range(3)] == [[1, 0, 0, 1], [0, 1, 0, 1], [0, 1, 0, 1]]


def test_frames_of_another_width_are_refused():
    with pytest.raises(FieldError, match=r"^motion: frames are 8 wide, expected 9"):
        build_reference(contract(), np.zeros((2, 8)))
