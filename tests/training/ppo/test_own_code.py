import math
from pathlib import Path

import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.training.ppo.environment import own_object


def test_a_name_in_a_file_and_in_a_module(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text("from dataclasses import dataclass\n\n@dataclass\nclass Mine:\n    x: int = 7\n")
    assert own_object("--task", f"{file}:Mine")().x == 7
    assert own_object("--task", "math:tau") is math.tau


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("mine.py:", r"^--task: is 'mine.py:', expected FILE.py:NAME or MODULE:NAME$"),
        (":Mine", r"^--task: is ':Mine', expected FILE.py:NAME or MODULE:NAME$"),
        ("mine.py:a b", "expected FILE.py:NAME"),
        ("no.py:Mine", r"^--task: 'no.py': no such file$"),
        ("no_such_module:Mine", r"^--task: 'no_such_module' cannot be imported: no module 'no_such_module'$"),
        ("mine.py:Mime", r"^--task: unknown name 'Mime' \(did you mean 'Mine'\?\) in 'mine.py'$"),
        ("broken.py:Mine", r"^--task: 'broken.py' cannot be imported: ZeroDivisionError: division by zero$"),
        ("wrong.py:Mine", r"^--task: 'wrong.py' cannot be imported: SyntaxError: "),
        ("ends.py:Mine", r"^--task: 'ends.py' cannot be imported: SystemExit: 3$"),
    ],
)
def test_what_cannot_be_used_is_one_line(text, expected, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, code in {
        "mine": "class Mine:\n    pass\n",
        "broken": "1 / 0\n",
        "wrong": "class\n",
        "ends": "import sys\nsys.exit(3)\n",
    }.items():
        Path(f"{name}.py").write_text(code)
    with pytest.raises(InputError, match=expected) as error:
        own_object("--task", text)
    assert "\n" not in str(error.value)
