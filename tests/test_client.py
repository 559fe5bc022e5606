"""The client as others use it: one file, in any Python that has NumPy."""

import shutil
import subprocess
import sys
from pathlib import Path

import humanoid_sim.client
from humanoid_sim.messages import Intent

FILE = Path(humanoid_sim.client.__file__)

PROGRAM = """
import sys
sys.path.append(sys.argv[1])
import humanoid_client as client
assert "numpy" not in sys.modules
with client.Feed(client.find_session()) as feed, client.Intake(feed.session, "outside") as intake:
    print(flush=True)
    tick = feed.decode(feed.wait(0, 10.0))
    print(tick["mode"], tick["joint_position"].tolist(), feed.joint_names)
    token = intake.post("load_a")
    print(intake.velocity(0.25, 0, 0, deliberate=True), flush=True)
    sys.stdin.readline()
    print(intake.answer(token, 5.0).granted)
assert "humanoid_sim" not in sys.modules
"""


def test_the_one_file_works_by_itself_in_an_isolated_python(local, tmp_path):
    shutil.copy(FILE, tmp_path / "humanoid_client.py")
    local.tick(Intent.DAMP)
    with subprocess.Popen(
        [sys.executable, "-I", "-c", PROGRAM, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as program:
        assert program.stdout.readline() == "\n"
        local.tick()
        assert program.stdout.readline() == "1 [0.4, 0.5, 0.6] ('shoulder', 'elbow', 'wrist')\n"
        assert program.stdout.readline() == "True\n"
        record = local.tick()
        assert program.communicate("\n")[0] == "True\n"
    assert record.input.intents == (Intent.LOAD_A,)
    assert record.input.state.extern["velocity_command"].value.tolist() == [0.25, 0.0, 0.0]
