import importlib.util
import subprocess
import sys

import pytest

from humanoid_sim import __version__
from humanoid_sim.cli import VERBS, load_program, main, run_program
from humanoid_sim.errors import InputError, MissingPackageError, RobotError


@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (InputError("x.onnx: is empty"), 2, "error: x.onnx: is empty"),
        (RobotError("can0: joint 3 is silent"), 2, "error: can0: joint 3 is silent"),
        (
            MissingPackageError("viser", "viewer", "--viewer web"),
            2,
            "error: --viewer web needs the package 'viser', which is not installed: pip install 'humanoid_sim[viewer]'",
        ),
        (PermissionError(13, "Permission denied", "robot.xml"), 2, "error: robot.xml: Permission denied"),
        (OSError(24, "Too many open files"), 2, "error: Too many open files"),
        (
            InputError("unknown term 'a\nb\x1b[31m\u2028\udc80', expected M⁻¹·K_d …"),
            2,
            "error: unknown term 'a\\nb\\x1b[31m\\u2028\\udc80', expected M⁻¹·K_d …",
        ),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
def test_what_ends_a_program_is_one_line_and_a_status(error, status, line, capsys):
    def program(arguments):
        raise error

    assert run_program(program) == status
    assert capsys.readouterr() == ("", f"{line}\n")


def test_the_list_of_verbs(capsys):
    for words in ([], ["-h"], ["--help"]):
        assert main(words) == 0
        out = capsys.readouterr().out
        assert out.startswith("usage: python -m humanoid_sim VERB [options]")
        assert max(len(line) for line in out.splitlines()) <= 80
        text = " ".join(out.split())
        for verb, purpose in VERBS.items():
            assert f"\n  {verb:<16}" in out
            assert f"{verb} {purpose}" in text
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"{__version__}\n"


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_is_a_program_with_help_and_one_line_for_bad_input(verb, capsys):
    assert importlib.util.find_spec(f"humanoid_sim.{verb}") is not None  # for `python -m`
    assert callable(load_program(verb))
    with pytest.raises(SystemExit) as caught:
        main([verb, "--help"])
    assert caught.value.code == 0
    assert f"usage: python -m humanoid_sim.{verb}" in capsys.readouterr().out
    if verb != "ros2_services":  # which has the standard library's parser
        assert main([verb, "--no-such-option"]) == 2
        assert capsys.readouterr().err.count("\n") == 1


def test_help_loads_nothing_heavy():
    code = (
        "import sys\nfrom humanoid_sim.play import main\ntry: main(['--help'])\nexcept SystemExit: pass\n"
        "print(*sorted({'mujoco', 'numpy', 'onnxruntime', 'onnx', 'av', 'PIL', 'mcap'} & set(sys.modules)))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.splitlines()[-1] == ""
