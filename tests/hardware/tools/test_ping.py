from humanoid_sim.hardware.mock.faults import Fault
from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.robots.description import load_robot

CHANNEL = "virtual:bench-ping"


def test_a_motor_says_who_and_how_it_is_without_being_enabled(run, inject):
    log = []
    with MockServer(load_robot("lite"), [CHANNEL], log=lambda _, text: log.append(text)) as motors:
        inject(motors, Fault("motor_fault", ("left_shoulder_yaw",)))
        status, printed, complained = run("ping", CHANNEL, "13")
    lines = (line.split(maxsplit=1) for line in printed.splitlines() if line.startswith("  "))
    values = {words[0]: words[1] for words in lines}
    assert (status, complained) == (0, "")
    assert printed.startswith(f"motor 13 on {CHANNEL}, unique id ")
    assert values["answered"].startswith("10 of 10, median ")
    assert (values["run_mode"], values["VBUS"], values["canTimeout"]) == ("0", "48 V", "0 (off)")
    assert (values["firmware"], values["faults"]) == ("0.0.3.255 (rs-00)", "phase_a_overcurrent")
    assert not any("enabled" in text for text in log)
