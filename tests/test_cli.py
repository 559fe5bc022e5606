import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

from humanoid_sim import __version__
from humanoid_sim.assets import asset_path
from humanoid_sim.cli import VERBS, load_program, main, run_program
from humanoid_sim.errors import InputError, MissingPackageError, RobotError


def failing(error):
    def program(arguments):
        raise error

    return run_program(program)


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
    assert failing(error) == status
    assert capsys.readouterr() == ("", f"{line}\n")


def test_a_bug_keeps_its_traceback():
    with pytest.raises(ZeroDivisionError):
        failing(ZeroDivisionError())


def test_a_program_gets_its_arguments_and_gives_its_status():
    seen = []

    def program(arguments):
        seen.append(arguments)
        return 7

    assert run_program(program, ["--x"]) == 7
    assert run_program(program) == 7
    assert seen == [["--x"], None]


def test_a_reader_that_leaves_makes_no_noise():
    code = "from humanoid_sim.cli import run_program\ndef p(a):\n while True: print('x' * 1000)\nrun_program(p)"
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        process.stdout.readline()
        process.stdout.close()
        assert process.stderr.read() == ""
        assert process.wait() == 0


def test_the_list_of_verbs(capsys):
    for word in ("-h", "--help"):
        assert main([word]) == 0
        out = capsys.readouterr().out
        assert out.startswith("usage: python -m humanoid_sim VERB [options]")
        assert max(len(line) for line in out.splitlines()) <= 80
        text = " ".join(out.split())
        for verb, purpose in VERBS.items():
            assert f"\n  {verb:<16}" in out
            assert f"{verb} {purpose}" in text
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"{__version__}\n"


def test_the_start_page(capsys):
    assert main([]) == 0
    out = capsys.readouterr().out
    assert max(len(line) for line in out.splitlines()) <= 80
    commands = [line.split()[3:] for line in out.splitlines() if line.startswith("  python -m ")]
    assert len(commands) == out.count("python -m humanoid_sim.") == 7
    text = " ".join(out.split())
    assert "robots lite, lite_biped, lite_neck, " in text
    assert "motions circle, drum, reach, wave " in text
    assert "suites lite_piano, lite_tracking, " in text
    assert "policies lite_biped_velocity, lite_piano, lite_tracking" in text
    assert "songs black_keys, " in text
    for kind in ("robots", "motions", "suites", "policies", "songs"):
        suffixes = {"policies": (".onnx",)}.get(kind, (".yaml", ".mcap", ".mid"))  # a contract is not a policy
        files = [path for path in asset_path(kind).iterdir() if path.suffix in suffixes]
        assert [path for path in files if path.name.partition(".")[0] not in text] == []


def test_an_unknown_verb(capsys):
    assert main(["dance"]) == 2
    assert capsys.readouterr() == ("", f"error: unknown verb 'dance'; known: {', '.join(VERBS)}\n")


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


def test_the_console_script_is_the_same_program():
    script = os.path.join(os.path.dirname(sys.executable), "humanoid-sim")
    run = subprocess.run([script, "--version"], capture_output=True, text=True, check=True)
    assert run.stdout == f"{__version__}\n"


def shell(redirect, code, unbuffered=""):
    program = f"import sys; from humanoid_sim.cli import run_program; sys.exit(run_program({code}))"
    return subprocess.run(
        ["bash", "-c", f'"$0" -c "$1" {redirect}', sys.executable, program],
        env={**os.environ, "PYTHONUNBUFFERED": unbuffered},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_full_output_is_one_line(unbuffered):
    run = shell(">/dev/full", "lambda _: print('x') or 0", unbuffered)
    assert (run.returncode, run.stderr) == (2, "error: No space left on device\n")


@pytest.mark.parametrize("words", [[], ["-h"], ["--help"], ["--version"]])
def test_a_page_of_the_package_itself_is_no_exception(words, monkeypatch, capsys):
    with open("/dev/full", "w", encoding="utf-8") as full:
        monkeypatch.setattr(sys, "stdout", full)
        assert main(words) == 2
        sys.stdout.close()  # which is muted by now
    assert capsys.readouterr().err == "error: No space left on device\n"


@pytest.mark.parametrize("encoding", ["ascii", "latin-1:strict", "ascii:surrogateescape"])
def test_characters_that_the_output_lacks_are_question_marks(encoding):
    code = "from humanoid_sim.cli import run_program; run_program(lambda _: print('A → B ≤ 5 K_d 中 \\udc80') or 0)"
    environment = {**os.environ, "PYTHONIOENCODING": encoding}
    run = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout, run.stderr) == (0, "A ? B ? 5 K_d ? ?\n", "")


LATE = "raise ImportError('initialization failed') from KeyboardInterrupt()"
"""What a library written in C makes of Ctrl-C while it loads."""


def test_ctrl_c_while_a_library_loads_is_one_line_and_status_130(capsys):
    error = ImportError("initialization failed")
    error.__cause__ = KeyboardInterrupt()
    assert failing(error) == 130
    assert capsys.readouterr() == ("", "interrupted\n")
    with pytest.raises(ImportError):
        failing(ImportError("no module"))


@pytest.mark.parametrize("raised", ["raise KeyboardInterrupt", LATE])
def test_ctrl_c_while_a_program_loads_is_one_line(raised, tmp_path):
    """`mcap` is one of the packages that `record` imports before it begins."""
    (tmp_path / "mcap.py").write_text(f"{raised}\n", encoding="utf-8")
    path = os.pathsep.join([str(tmp_path), str(Path(__file__).parents[1])])
    run = subprocess.run(
        [sys.executable, "-m", "humanoid_sim.record", "info", "x.mcap"],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.stderr == "interrupted\n"
    assert run.returncode == 130


def test_testing_is_no_program_and_without_its_extra_says_what_to_install(tmp_path):
    command = [sys.executable, "-m", "humanoid_sim.testing"]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stderr.count("\n")) == (2, 1)
    assert run.stderr.startswith("error: humanoid_sim.testing: is not a program")
    (tmp_path / "hypothesis.py").write_text("raise ImportError\n", encoding="utf-8")
    path = os.pathsep.join([str(tmp_path), str(Path(__file__).parents[1])])
    environment = {**os.environ, "PYTHONPATH": path}
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stderr.count("\n")) == (2, 1)
    assert run.stderr.startswith("error: humanoid_sim.testing needs the package 'hypothesis'")
