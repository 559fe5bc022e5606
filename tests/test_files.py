import json
import os
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.files import exclusive_file, is_file, output_file, regular_file, whole_file
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.strict_yaml import read_yaml


def refusal(path):
    with pytest.raises(InputError) as caught:
        regular_file(path, "a motion file (.mcap)")
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_what_is_no_file_is_named(tmp_path):
    pipe, loop = tmp_path / "pipe", tmp_path / "loop"
    os.mkfifo(pipe)
    loop.symlink_to(loop)
    gone, long = tmp_path / "gone", "x" * 5000
    assert refusal(gone) == f"{gone}: no such file, expected a motion file (.mcap)"
    assert refusal(tmp_path) == f"{tmp_path}: is a directory, expected a motion file (.mcap)"
    assert refusal(pipe) == f"{pipe}: is a pipe or a device, expected a motion file (.mcap)"
    assert refusal("/dev/zero") == "/dev/zero: is a pipe or a device, expected a motion file (.mcap)"
    assert refusal(loop) == f"{loop}: cannot be read: Too many levels of symbolic links"
    assert refusal(long) == f"{long}: cannot be read: File name too long"
    assert refusal("a\0b") == "a\0b: cannot be read: embedded null byte"
    for path in (gone, tmp_path, pipe, loop, long, "a\0b"):
        assert not is_file(path)


def test_a_file_that_its_user_may_not_read_is_one_line():
    with tempfile.TemporaryDirectory(dir="/tmp") as folder:  # pytest's own is closed to others
        os.chmod(folder, 0o755)
        path = Path(folder) / "robot.xml"
        path.touch(mode=0o000)
        user = os.geteuid()
        os.seteuid(65534 if user == 0 else user)
        try:
            assert refusal(path) == f"{path}: cannot be read: Permission denied"
        finally:
            os.seteuid(user)


def test_a_block_that_raises_leaves_what_was_there(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"before")
    with pytest.raises(TypeError), whole_file(path) as file:
        file.write("text")
    assert path.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [path]


_WRITERS = {
    "report": "write_summary(path, {'number': i, 'values': [i] * 100_000})",
    "stamp": "main(['stamp', 'lite_tracking', '--overwrite', '--output', str(path)])",
    "calibration": "save_calibration(path, {f'joint_{k}': CalibrationEntry(k + 1, 1, 0.25) for k in range(60)})",
    "checkpoint": "torch.save({'weights': torch.ones(1_000_000)}, stack.enter_context(whole_file(path)))",
}
_IMPORTS = {
    "report": "from humanoid_sim.play.report import write_summary",
    "stamp": "from humanoid_sim.policy_tools import main",
    "calibration": "from humanoid_sim.hardware.calibration import CalibrationEntry, save_calibration",
    "checkpoint": "import torch; from humanoid_sim.files import whole_file",
}
_READERS = {
    "report": lambda path: set(json.loads(path.read_text())["values"]) == {json.loads(path.read_text())["number"]},
    "stamp": lambda path: load_checkpoint(path).golden,
    "calibration": lambda path: len(read_yaml(path)) == 60,
    "checkpoint": lambda path: pytest.importorskip("torch").load(path, weights_only=True)["weights"].sum() == 1e6,
}
_PROGRAM = """
import contextlib, itertools, os, sys; from pathlib import Path
path, out = Path(sys.argv[1]), os.dup(1)
for i in itertools.count():
    with contextlib.ExitStack() as stack:
        {}
    os.write(out, b".")
"""


@pytest.mark.soak
@pytest.mark.parametrize("name", _WRITERS)
def test_one_that_is_killed_leaves_the_old_file_or_the_new_one(name, tmp_path):
    moments, path = random.Random(name), tmp_path / "file.onnx"
    program = _IMPORTS[name] + _PROGRAM.format(_WRITERS[name])
    for _ in range(6):
        command = [sys.executable, "-c", program, str(path)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
            assert process.stdout.read(1), "it ended"
            time.sleep(moments.uniform(0.0, 0.3))
            process.kill()
        assert _READERS[name](path)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("run.avi", r"^video: is '.*run\.avi', expected a name that ends in \.mp4 or \.mov$"),
        ("run", r"^video: is '.*run', expected a name that ends in \.mp4 or \.mov$"),
        ("missing/run.mp4", r"^video: the folder '.*missing' does not exist$"),
        ("folder.mp4", r"^video: '.*folder\.mp4' is a directory, expected a file name$"),
        ("pipe.mp4", r"^video: '.*pipe\.mp4' is a pipe or a device, expected a file name$"),
        ("there.mp4", r"^video: '.*there\.mp4' exists; choose another name, or add --overwrite$"),
        (f"{'x' * 300}.mp4", r"^video: '.*' cannot be written: File name too long$"),
    ],
)
def test_a_bad_output_is_refused(tmp_path, name, message):
    (tmp_path / "folder.mp4").mkdir()
    os.mkfifo(tmp_path / "pipe.mp4")
    (tmp_path / "there.mp4").touch()
    with pytest.raises(InputError, match=message):
        output_file(tmp_path / name, "video", ".mp4", ".mov", overwrite=False)
    assert output_file(tmp_path / "there.mp4", "video") == tmp_path / "there.mp4"


def test_a_file_that_somebody_writes_is_left_alone(tmp_path):
    path = tmp_path / "run.mcap"
    with exclusive_file(path) as file:
        file.write(b"first")
        with pytest.raises(InputError, match=r"run\.mcap: is being written by another session; choose another name"):
            exclusive_file(path)
        with pytest.raises(
            InputError, match=r"--record: '.*' is being written by another session; choose another name"
        ):
            output_file(path, "--record")
        with pytest.raises(InputError, match="is being written by another session"), whole_file(path) as other:
            other.write(b"second")
    assert path.read_bytes() == b"first"
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.mcap"]
    assert output_file(path, "--record") == path
    with pytest.raises(InputError, match=r"run\.mcap: exists; choose another name"):
        exclusive_file(path, overwrite=False)
    with exclusive_file(path) as file:
        assert path.read_bytes() == b""
