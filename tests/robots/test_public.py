"""Public robots by name: from robot_descriptions' own cache, and one line where they cannot be had."""

import subprocess
import sys

import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.robots.description import load_robot, public_name

pytest.importorskip("robot_descriptions")
pytestmark = pytest.mark.peers

SCENE = """<mujoco model="g1"><worldbody><body name="pelvis"><freejoint/><geom size="0.1" mass="3"/>
<body name="leg"><joint name="hip" range="-1 1" axis="0 1 0"/><geom size="0.05" mass="1"/></body>
</body></worldbody><actuator><motor joint="hip"/></actuator></mujoco>"""
PROGRAM = """
import sys
from robot_descriptions import _repositories
_repositories.REPOSITORIES["mujoco_menagerie"] = _repositories.Repository(
    url=sys.argv[2], commit=sys.argv[3], cache_path="mujoco_menagerie"
)
from humanoid_sim.errors import InputError
from humanoid_sim.robots.description import load_robot
try:
    robot = load_robot(sys.argv[1])
except InputError as error:
    sys.exit(f"error: {error}")
print(robot.name, *robot.joint_names, robot.is_floating)
"""


def git(folder, *arguments):
    identity = ("-c", "user.name=a", "-c", "user.email=a@b.c")
    return subprocess.run(
        ["git", *identity, *arguments], cwd=folder, check=True, capture_output=True, text=True
    ).stdout.strip()


def loaded(name, repository, commit, cache):
    """In a process of its own: that package fetches when it is imported."""
    return subprocess.run(
        [sys.executable, "-c", PROGRAM, name, str(repository), commit],
        capture_output=True,
        text=True,
        env={"PATH": "/usr/bin:/bin", "ROBOT_DESCRIPTIONS_CACHE": str(cache), "PYTHONPATH": ":".join(sys.path)},
        timeout=120,
        check=False,
    )


@pytest.fixture
def repository(tmp_path):
    folder = tmp_path / "origin"
    (folder / "unitree_g1").mkdir(parents=True)
    (folder / "unitree_g1" / "g1.xml").write_text(SCENE)
    git(folder, "init", "-q")
    git(folder, "add", ".")
    git(folder, "commit", "-qm", "a robot")
    return folder, git(folder, "rev-parse", "HEAD")


def test_a_robot_is_fetched_once_and_then_there(repository, tmp_path):
    origin, commit = repository
    cache = tmp_path / "cache"
    first = loaded("robot_descriptions:g1", origin, commit, cache)
    assert (first.returncode, first.stdout) == (0, "g1 hip True\n"), first.stderr
    origin.rename(tmp_path / "gone")
    again = loaded("robot_descriptions:g1", origin, commit, cache)
    assert (again.returncode, again.stdout) == (0, "g1 hip True\n"), again.stderr


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("g1", "robot_descriptions:g1"),
        ("unitree_g1", "robot_descriptions:g1"),
        ("Unitree-G1", "robot_descriptions:g1"),
        ("talso", "robot_descriptions:talos"),
        ("mine", ""),
    ],
)
def test_the_public_robot_that_was_meant(name, meant):
    assert public_name(name) == meant
    with pytest.raises(InputError) as caught:
        load_robot(name)
    assert str(caught.value).endswith(f"; or a file that exists; did you mean {meant}?" if meant else "that exists")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("robot_descriptions:g7", "unknown public robot 'g7'; known: a1, "),
        ("robot_descriptions:atlas_drc", "has this robot as a URDF only; `python -m humanoid_sim.robot convert`"),
    ],
)
def test_a_robot_that_the_package_does_not_have_is_one_line(name, message):
    with pytest.raises(InputError) as caught:
        load_robot(name)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_robot_that_cannot_be_fetched_is_one_line(tmp_path):
    run = loaded("robot_descriptions:g1", tmp_path / "nowhere", "0" * 40, tmp_path / "cache")
    assert run.returncode == 1
    (line,) = [line for line in run.stderr.splitlines() if line.startswith("error: ")]
    assert "robot_descriptions:g1: could not be fetched: " in line
    assert run.stdout == ""
