"""Builds interface packages with the wheels of ROS 2, as colcon would with an installation; `make test-ros` runs it.

`examples/ros2/humanoid_control_msgs` is what users build; those in `interfaces/` have no wheels, and hold what is on
`/tf`.
"""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path

from machines import ROOT, ROS_PYTHON

PACKAGES = (
    ROOT / "examples" / "ros2" / "humanoid_control_msgs",
    *sorted(Path(__file__).with_name("interfaces").iterdir()),
)
_ENVIRONMENT = ROS_PYTHON.parent.parent


def folder_of(package: Path) -> Path:
    """Where a package is installed, beside the wheels."""
    return _ENVIRONMENT / "interfaces" / package.name


def build(package: Path) -> None:
    """Compile and install a package."""
    shutil.rmtree(folder_of(package), ignore_errors=True)
    settings = {
        "CMAKE_PREFIX_PATH": _ENVIRONMENT,
        "CMAKE_INSTALL_PREFIX": folder_of(package),
        "CMAKE_PROJECT_INCLUDE": Path(__file__).with_name("wheels.cmake"),
        "Python3_FIND_VIRTUALENV": "ONLY",
        "BUILD_TESTING": "OFF",
    }
    options = [f"-D{name}={value}" for name, value in settings.items()]
    variables = {
        "PATH": f"{_ENVIRONMENT / 'bin'}:{os.environ['PATH']}",
        "VIRTUAL_ENV": str(_ENVIRONMENT),
        "AMENT_PREFIX_PATH": str(_ENVIRONMENT),
    }
    with tempfile.TemporaryDirectory() as folder:
        for command in (
            ["cmake", "-S", str(package), "-B", folder, "-G", "Ninja", *options],
            ["cmake", "--build", folder, "--target", "install"],
        ):
            subprocess.run(command, env=variables, check=True)


def variables() -> Mapping[str, str]:
    """The environment in which ROS 2's Python finds the packages, as their `setup.bash` would set it."""
    installed = [folder_of(package) for package in PACKAGES]
    packages = (path for folder in installed for path in folder.glob("lib/python3.*/site-packages"))
    return {
        "PYTHONPATH": ":".join(map(str, packages)),
        "LD_LIBRARY_PATH": ":".join(str(folder / "lib") for folder in installed),
    }


if __name__ == "__main__":
    for package in PACKAGES:
        build(package)
