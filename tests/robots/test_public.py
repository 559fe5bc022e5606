"""Public robots by name: from robot_descriptions' own cache, and one line where they cannot be had."""

import subprocess
import sys

import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.robots.description import load_robot

pytest.importorskip("robot_descriptions")
pytestmark = pytest.mark.peers

SCENE = """<mujoco model="g1"><worldbody><body name="pelvis"><freejoint/><geom size="0.1" mass="3"/>
<body name="leg"><joint name="hip" range="-1 1" axis="0 1 0"/><geom size="0.05" mass="1"/></body>
</body></worldbody><actuator><motor joint="hip"/></actuator></mujoco>"""
PROGRAM = """
import sys
from robot_descriptions import _repositories
_repositories.REPOSITORIES["mujoco_menagerie"] = _repositories.Repository(
    url=sys.argv[1], commit=sys.argv[2], cache_path="mujoco_menagerie"
)
from humanoid_sim.errors import InputError
from humanoid_sim.robots.description import load_robot
try:
    robot = load_robot("robot_descriptions:g1")
except InputError as error:
    sys.exit(f"error: {error}")
print(robot.name, *robot.joint_names, robot.is_floating)
"""


def git(folder, *arguments):
    command = ["git", "-c", "user.name=a", "-c", "user.email=a@b.c", *arguments]
    return subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True).stdout.strip()


def loaded(repository, commit, cache):
    """In a process of its own: that package fetches when it is imported."""
    return subprocess.run(
        [sys.executable, "-c", PROGRAM, str(repository), commit],
        capture_output=True,
        text=True,
        env={"PATH": "/usr/bin:/bin", "ROBOT_DESCRIPTIONS_CACHE": str(cache), "PYTHONPATH": ":".join(sys.path)},
        timeout=120,
        check=False,
    )


def test_a_robot_is_fetched_once_and_one_that_cannot_be_is_one_line(tmp_path):
    origin, cache = tmp_path / "origin", tmp_path / "cache"
    (origin / "unitree_g1").mkdir(parents=True)
    (origin / "unitree_g1" / "g1.xml").write_text(SCENE)
    git(origin, "init", "-q")
    git(origin, "add", ".")
    git(origin, "commit", "-qm", "a robot")
    commit = git(origin, "rev-parse", "HEAD")
    for _ in range(2):
        run = loaded(origin, commit, cache)
        assert (run.returncode, run.stdout) == (0, "g1 hip True\n"), run.stderr
        if origin.exists():
            origin.rename(tmp_path / "gone")
    run = loaded(origin, commit, tmp_path / "another cache")
    (line,) = [line for line in run.stderr.splitlines() if line.startswith("error: ")]
    assert "robot_descriptions:g1: could not be fetched: " in line


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("robot_descriptions:unitree_g1", "robot_descriptions:unitree_g1: unknown public robot; near: g1"),
        ("robot_descriptions:talso", "unknown public robot; near: talos"),
        ("robot_descriptions:zzzz", "unknown public robot; known: a1, "),
        ("robot_descriptions:atlas_drc", "is there as a URDF only"),
        ("mine", "or a file that exists"),
    ],
)
def test_a_wrong_name_gives_the_near_ones_in_one_line(name, message):
    with pytest.raises(InputError) as caught:
        load_robot(name)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
