"""Motion references: the layouts of motion files."""

import numpy as np
import pytest
from rig import contract

from humanoid_sim.controllers.reference import build_reference
from humanoid_sim.errors import FieldError

PIANO = {"task_type": "piano", "observation": ("target_keys",), "lookahead_steps": (1, 2)}


def test_a_tracking_motion_is_cut_into_positions_and_orientations():
    two = contract(body_names=("left_hand", "right_hand"))
    motion = build_reference(two, np.arange(36.0).reshape(2, 18))
    assert motion.frame_count == 2
    assert motion.term("motion_body_pos_b", 0).tolist() == [0, 1, 2, 3, 4, 5]
    assert motion.term("motion_body_ori_b", 1).tolist() == list(range(24, 36))


def test_a_song_looks_ahead_and_holds_its_end():
    song = build_reference(contract(**PIANO), [[0, 0], [1, 0], [0, 1]])
    assert song.term("target_keys", 1).tolist() == [1, 0]
    assert [song.term("target_keys_future", k).tolist() for k in range(3)] == [[1, 0, 0, 1], [0, 1, 0, 1], [0, 1, 0, 1]]


def test_frames_of_another_width_are_refused():
    with pytest.raises(FieldError, match=r"^motion: frames are 8 wide, expected 9"):
        build_reference(contract(), np.zeros((2, 8)))
