import subprocess
import sys

import pytest

from humanoid_sim.hardware import main

_TOOLS = (
    *("discover", "ping", "param", "calibrate", "identify"),
    *("emulate", "set-id", "set-zero"),
)


def test_help_lists_every_tool(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    printed = capsys.readouterr().out
    assert [tool for tool in _TOOLS if f" {tool} " not in printed] == []


def test_help_imports_nothing_heavy():
    program = (
        "import sys\n"
        "from humanoid_sim.hardware import main\n"
        "try:\n    main(['calibrate', '--help'])\nexcept SystemExit:\n    pass\n"
        "print('heavy:', sorted({'can', 'mujoco', 'numpy', 'onnxruntime', 'yaml'} & set(sys.modules)))\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.endswith("heavy: []\n")
