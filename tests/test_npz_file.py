"""Arrays from a stranger's .npz file."""

import struct
import zipfile

import numpy as np
import pytest

from humanoid_sim import npz_file
from humanoid_sim.errors import InputError
from humanoid_sim.npz_file import read_arrays


def claiming(path, description, shape):
    """An archive whose one array says that it is more than the eight bytes that it has."""
    header = f"{{'descr': {description}, 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a.npy", b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + bytes(8))
    return path


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


@pytest.mark.parametrize(
    ("description", "shape", "problem"),
    [
        ("'<f8'", "(1099511627776,)", "a claims shape (1099511627776,) of float64, and has "),
        ("'<U100000000'", "(3,)", "a claims shape (3,) of <U100000000, and has "),
        ("'<f8'", "(-1, 3)", "a claims shape (-1, 3) of float64, and has "),
        ("'|O'", "(1,)", "is not a complete .npz file of plain arrays: a.npy: Object arrays cannot be loaded"),
        ("'<f8'", "(1,", "is not a complete .npz file of plain arrays: "),
        ("'x'", "(1,)", "is not a complete .npz file of plain arrays: "),
    ],
)
def test_a_header_is_not_believed(tmp_path, description, shape, problem):
    assert refusal(claiming(tmp_path / "a.npz", description, shape)).startswith(problem)


def test_what_unpacks_to_more_than_any_motion_is_refused(tmp_path, monkeypatch):
    np.savez_compressed(tmp_path / "a.npz", x=np.zeros(10_000), y=np.zeros(10_000))
    assert (tmp_path / "a.npz").stat().st_size < 2000
    monkeypatch.setattr(npz_file, "NPZ_BYTES", 100_000)
    assert refusal(tmp_path / "a.npz") == "its arrays have 160256 bytes, expected at most 100000"


def test_a_single_array_is_no_archive(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros(3))
    assert refusal(tmp_path / "a.npy") == "holds a single array (.npy), expected an .npz file of several"


def test_texts_beyond_unicode_are_refused(tmp_path):
    names = np.array(["ab", "c"])
    names.view(np.uint32)[1] = 0x7FFFFFFF
    np.savez(tmp_path / "a.npz", names=names)
    assert refusal(tmp_path / "a.npz").endswith("names.npy holds texts that are none")
