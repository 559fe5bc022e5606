"""Arrays from a stranger's .npz file."""

import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.npz_file import read_arrays


def refusal(path):
    with pytest.raises(InputError) as caught:
        read_arrays(path)
    return str(caught.value).removeprefix(f"{path}: ")


def test_what_numpy_wrote_is_read(tmp_path):
    np.savez_compressed(tmp_path / "a.npz", x=np.arange(6.0).reshape(2, 3), names=np.array(["a", "bc"]))
    arrays = read_arrays(tmp_path / "a.npz")
    assert list(arrays) == ["x", "names"]
    assert arrays["x"].tolist() == [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]
    assert arrays["names"].tolist() == ["a", "bc"]


def test_arrays_that_need_code_are_refused(tmp_path):
    np.savez(tmp_path / "a.npz", x=np.array([{}], dtype=object))
    assert refusal(tmp_path / "a.npz").startswith("is not a complete .npz file of plain arrays: Object arrays")


def test_an_archive_that_was_cut_is_one_line(tmp_path):
    np.savez(tmp_path / "a.npz", x=np.zeros(100))
    (tmp_path / "a.npz").write_bytes((tmp_path / "a.npz").read_bytes()[:300])
    assert refusal(tmp_path / "a.npz").startswith("is not a complete .npz file of plain arrays: ")
