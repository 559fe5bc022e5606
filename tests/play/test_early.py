"""What is wrong with options is said before anything heavy is imported."""

import subprocess
import sys
from pathlib import Path

import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.play.conflicts import refuse_early
from humanoid_sim.play.options import PlayConfig

PROGRAM = """
import sys
from humanoid_sim.errors import InputError
from humanoid_sim.play import main
try:
    main(sys.argv[1:])
except InputError as error:
    print(error)
print(*(name for name in ("mujoco", "onnxruntime", "onnx") if name in sys.modules), sep=",")
"""


def test_a_file_of_a_trainer_is_refused_before_mujoco_is_imported(tmp_path: Path) -> None:
    policy = tmp_path / "my.pt"
    run = subprocess.run(
        [sys.executable, "-c", PROGRAM, "--policy", str(policy)], capture_output=True, text=True, check=True
    )
    assert run.stdout == f"{policy}: no such file, expected an ONNX file: export it to ONNX first\n\n"


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("my.pt", "is a PyTorch checkpoint, expected an ONNX file: export it to ONNX first"),
        ("my.PTH", "is a PyTorch checkpoint, expected an ONNX file: export it to ONNX first"),
        ("best.zip", "is a stable-baselines3 checkpoint, expected an ONNX file: give the policy.onnx beside it"),
    ],
)
def test_what_to_do_with_a_trainers_own_file(name: str, line: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(b"PK")
    with pytest.raises(InputError) as caught:
        refuse_early(PlayConfig(policy=str(path)))
    assert str(caught.value) == f"{path}: {line}"


def test_what_is_right_passes() -> None:
    refuse_early(PlayConfig())
    refuse_early(PlayConfig(policy="placeholder", command="0.5,0,-1"))
