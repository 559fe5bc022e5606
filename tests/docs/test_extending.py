"""The guides of CONTRIBUTING.md work word by word: one of each is added to a copy of the tree, checked and used."""

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]
ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
GUIDES = PAGE[PAGE.index("\n## Add one of these\n") : PAGE.index("\n## Layout\n")]
STEP = re.compile(r"^(?:`([^`]+)`, (.*?)):\n\n```\w+\n(.*?)^```$|^```sh\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LOOKS_AGAIN = (
    "tests/controllers/test_term_kinds.py",
    "tests/docs/test_docstrings.py",
    "tests/docs/test_pages.py",
    "tests/envs/test_tasks.py",
    "tests/frontends/test_fates.py::test_every_front_end_has_a_row",
    "tests/hardware/test_families.py",
    "tests/policy/test_contract_page.py",
    "tests/robots/test_description.py",
    "tests/robots/test_motors.py",
    "tests/test_cli.py::test_every_verb_is_a_program_with_help_and_one_line_for_bad_input",
    "tests/test_cli.py::test_the_list_of_verbs",
    "tests/test_contributing.py",
    "tests/test_extras.py",
    "tests/training/ppo/test_options.py::test_help_names_every_task_and_algorithm",
)
"""Tests that list what there is."""

Run = Callable[..., str]


def apply(tree: Path, file: str, place: str, block: str) -> None:
    """Do what a guide says: put a block into a file of the tree."""
    path = tree / file
    if place == "a new file":
        assert not path.exists()
        path.write_text(block, encoding="utf-8")
        return
    text = path.read_text(encoding="utf-8")
    if place == "an import":
        at = text.index("\nfrom humanoid_sim.") + 1
    else:
        where, name = re.match(r"(above|at the (?:beginning|end) of) `([^`]+)`", place).groups()  # type: ignore[union-attr]
        block = block if where == "above" or path.suffix == ".md" else f"{block.rstrip()},\n"
        begin = re.search(rf"^{re.escape(name)}.*\n", text, re.MULTILINE)
        assert begin is not None
        if where == "above":
            at = begin.start()
        elif where.endswith("beginning of"):
            at = text.index("{\n", begin.start()) + 2
        else:  # a table of Python ends with a bracket, one of Markdown with an empty line
            end = re.compile(r"^(?:    }|\)|)$", re.MULTILINE).search(text, begin.end())
            assert end is not None
            at = end.start()
    path.write_text(f"{text[:at]}{block}{text[at:]}", encoding="utf-8")


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the tree, without what git ignores, extended as the guides say."""
    ignored = [line.rstrip("/") for line in (ROOT / ".gitignore").read_text(encoding="utf-8").splitlines()]
    tree = tmp_path_factory.mktemp("extended") / "tree"
    shutil.copytree(ROOT, tree, symlinks=True, ignore=shutil.ignore_patterns(".git", *ignored))
    steps = STEP.findall(GUIDES)
    assert len(steps) == GUIDES.count("```") // 2 > 10, "each block says where it goes"
    for file, place, block, shell in steps:
        if shell:
            subprocess.run(["bash", "-ec", shell], cwd=tree, check=True)
        else:
            apply(tree, file, place, block)
    for cache in (".mypy_cache", ".import_linter_cache"):  # of what has not changed, where it was checked before
        if (ROOT / cache).is_dir():
            shutil.copytree(ROOT / cache, tree / cache)
    return tree


@pytest.fixture(scope="module")
def run(tree: Path) -> Run:
    """Run a program of this environment in the copy; what it prints."""

    def run(*words: str, status: int = 0) -> str:
        environment = {**os.environ, "PYTHONPATH": str(tree)}
        command = [sys.executable, *words] if words[0] in ("-m", "-c") else [_tool(words[0]), *words[1:]]
        ended = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, check=False)
        assert ended.returncode == status, ended.stdout + ended.stderr
        return ended.stdout

    assert Path(run("-c", "import humanoid_sim as h; print(h.__file__)").strip()).is_relative_to(tree)
    run("ruff", "check", "--fix", "--quiet", ".")
    run("ruff", "format", "--quiet", ".")
    return run


def _tool(name: str) -> str:
    return str(Path(sys.executable).parent / name)


def test_a_guide_edits_no_more_than_it_promises() -> None:
    files = {
        title: {file for file, _, _, _ in STEP.findall(text) if file}
        for title, text in re.findall(r"^### (.*?)\n(.*?)(?=^### |\Z)", GUIDES, re.MULTILINE | re.DOTALL)
    }
    assert {title: len(names) for title, names in files.items()} == {
        "An observation term": 2,
        "A task": 2,
        "A front end": 2,
        "A family of motors": 2,  # beside its folder
    }


def test_lint_imports_and_types(run: Run) -> None:
    run("ruff", "check", ".")
    run("lint-imports", "--no-logo")
    modules = ("lamp", "envs.tasks.stillness", "hardware.families", "hardware.acme.emulated", "controllers.term_kinds")
    run("mypy", *(word for module in modules for word in ("-m", f"humanoid_sim.{module}")))


def test_the_tests_that_list_what_there_is(run: Run) -> None:
    run("-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *LOOKS_AGAIN)


EPISODE = """
import sys
import numpy as np
from humanoid_sim.envs.policy_env import PolicyEnv

env = PolicyEnv(sys.argv[1], "lite_biped", task="stillness", episode_seconds=0.5)
observation, _ = env.reset(seed=0)
assert observation[-1] > 0.99, "it stands"
terminated = truncated = False
while not (terminated or truncated):
    observation, _, terminated, truncated, info = env.step(np.zeros(env.action_space.shape, np.float32))
assert 0.0 < info["terms"]["still"] <= 0.02
print(truncated)
"""


def test_an_episode_of_the_task_whose_policy_observes_the_term(tree: Path, run: Run, tmp_path: Path) -> None:
    shipped = tree / "assets" / "policies" / "lite_biped_velocity.contract.yaml"
    contract = yaml.safe_load(shipped.read_text(encoding="utf-8"))
    contract["observation"].append("uprightness")
    (tmp_path / "contract.yaml").write_text(yaml.safe_dump(contract), encoding="utf-8")
    assert run("-c", EPISODE, str(tmp_path / "contract.yaml")) == "True\n"


@pytest.fixture(scope="module")
def robot(tree: Path) -> str:
    """The robot with motors of two families, one of which is the new one."""
    text = (tree / "assets" / "robots" / "lite_sito.yaml").read_text(encoding="utf-8")
    for old, new in (("family: sito", "family: acme"), ("TA40-50", "acme-17"), ("../mjcf", str(tree / "assets/mjcf"))):
        assert old in text
        text = text.replace(old, new)
    path = tree.parent / "lite_acme.yaml"
    path.write_text(text, encoding="utf-8")
    return str(path)


TOOLS = """
import sys
from humanoid_sim.hardware.emulation.virtual import VirtualMotors
from humanoid_sim.hardware.tools import main
from humanoid_sim.robots.description import load_robot
from humanoid_sim.session.realtime import punctual_threads

on = ["virtual:acme", "--robot", sys.argv[1]]
with punctual_threads(behind=10), VirtualMotors(load_robot(sys.argv[1]), on[:1]):
    assert main(["discover", *on, "--wait", "0.005"]) == 0
    assert main(["identify", *on, "left_wrist_roll", "--angle", "0.1", "--yes", "--allow-no-timeout"]) == 0
"""


def test_the_bench_tools_find_and_move_an_emulated_motor_of_the_family(run: Run, robot: str) -> None:
    assert "--family robstride|sito|acme" in run("-m", "humanoid_sim", "hardware", "ping", "--help")
    printed = run("-c", TOOLS, robot)
    assert "not heard: left_wrist_roll (motor 16 on virtual:acme), " in printed
    assert "that proves nothing: the Acme protocol has no question" in printed
    assert re.search(r"motor 16 moved by -0\.\d+ rad", printed)


def test_the_front_end_watches_a_run_on_motors_of_the_family(
    tree: Path, run: Run, robot: str, runtime: Path, tmp_path: Path
) -> None:
    assert "lamp            print the mode of a running session" in run("-m", "humanoid_sim", "--help")
    assert "--session" in run("-m", "humanoid_sim.lamp", "--help")
    on_motors = ("--robot", robot, "--hardware", "virtual:acme", "--allow-no-timeout", "--yes", "--allow-script")
    script = ("--policy", "placeholder", "--script", "hold 8; damp; hold 1; load_a; wait; damp; hold 1")
    command = (sys.executable, "-m", "humanoid_sim.play", *on_motors, *script, "--record", str(tmp_path / "r.mcap"))
    environment = {**os.environ, "PYTHONPATH": str(tree)}
    with subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, text=True) as play:
        end = time.monotonic() + 60.0
        while not list(runtime.rglob("*.session")) and play.poll() is None and time.monotonic() < end:
            time.sleep(0.05)
        seen = run("-m", "humanoid_sim", "lamp").split("\n")
        told, _ = play.communicate(timeout=60.0)
    assert play.returncode == 0, told
    assert seen[0].startswith("lamp for ")
    assert seen[1:] == ["ZERO_TORQUE", "DAMPING", "STANDBY", "DAMPING", ""]
