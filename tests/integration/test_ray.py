"""Episodes on a real Ray are those of one machine."""

import subprocess
import sys

import pytest
from regress_runs import SAMPLE, yaml_suite

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]


def test_two_workers_of_a_local_ray_give_the_same_file(tmp_path, runtime, monkeypatch):
    """In processes of their own: Ray leaves threads behind, and takes its time."""
    monkeypatch.setenv("RAY_TMPDIR", str(runtime))  # its logs and sockets, whose paths must be short
    yaml_suite(tmp_path)

    def regress(output, *options):
        command = [sys.executable, "-m", "humanoid_sim.regress", str(SAMPLE), "--suite", "suite.yaml"]
        subprocess.run([*command, "--json", output, *options], cwd=tmp_path, check=True, timeout=300)
        return (tmp_path / output).read_bytes()

    assert regress("cluster.json", "--ray", "local") == regress("one.json")


def test_an_address_where_no_cluster_answers_is_named_at_once():
    command = [sys.executable, "-m", "humanoid_sim.regress", str(SAMPLE), "--suite", "lite_tracking"]
    command += ["--ray", "127.0.0.1:9"]
    result = subprocess.run(command, check=False, capture_output=True, text=True, timeout=300)
    assert (result.returncode, result.stderr.count("\n")) == (2, 1)
    assert "--ray: is '127.0.0.1:9', and no cluster answers there" in result.stderr
