"""Builds interface packages with the wheels of ROS 2, as colcon would with an installation.

`examples/ros2/humanoid_control_msgs` is the one under test; those in `interfaces/` have no wheels, and hold what is on
`/tf`. As a program it builds all, so that no test waits for the compiler.
"""

import hashlib
import os
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path

from machines import ROOT, ROS_PYTHON

PACKAGE = ROOT / "examples" / "ros2" / "humanoid_control_msgs"
MADE = tuple(sorted(Path(__file__).with_name("interfaces").iterdir()))
_WHEELS = Path(__file__).with_name("wheels.cmake")


def build(package: Path = PACKAGE) -> Path:
    """Compile and install a package beside the wheels, once for each state of its files; the folder it is in."""
    files = sorted(path for path in package.rglob("*") if path.is_file())
    state = hashlib.sha256(b"".join(path.name.encode() + path.read_bytes() for path in [*files, _WHEELS])).hexdigest()
    environment = ROS_PYTHON.parent.parent
    installed = environment / "interfaces" / state[:16]
    if installed.exists():
        return installed
    folder = installed.with_name(f"building-{os.getpid()}")
    shutil.rmtree(folder, ignore_errors=True)
    settings = {
        "CMAKE_PREFIX_PATH": environment,
        "CMAKE_INSTALL_PREFIX": folder / "installed",
        "CMAKE_PROJECT_INCLUDE": _WHEELS,
        "Python3_FIND_VIRTUALENV": "ONLY",
        "BUILD_TESTING": "OFF",
    }
    options = [f"-D{name}={value}" for name, value in settings.items()]
    variables = {
        "PATH": f"{environment / 'bin'}:{os.environ['PATH']}",
        "VIRTUAL_ENV": str(environment),
        "AMENT_PREFIX_PATH": str(environment),
    }
    for command in (
        ["cmake", "-S", str(package), "-B", str(folder / "build"), "-G", "Ninja", *options],
        ["cmake", "--build", str(folder / "build"), "--target", "install"],
    ):
        run = subprocess.run(command, env=variables, capture_output=True, text=True, check=False)
        assert run.returncode == 0, run.stdout[-4000:] + run.stderr[-4000:]
    (folder / "installed").rename(installed)
    shutil.rmtree(folder)
    return installed


def variables_of(*installed: Path) -> Mapping[str, str]:
    """The environment in which ROS 2's Python finds packages, as their `setup.bash` would set it."""
    packages = (path for folder in installed for path in folder.glob("lib/python3.*/site-packages"))
    return {
        "PYTHONPATH": ":".join(map(str, packages)),
        "LD_LIBRARY_PATH": ":".join(str(folder / "lib") for folder in installed),
    }


if __name__ == "__main__":
    for package in (PACKAGE, *MADE):
        build(package)
