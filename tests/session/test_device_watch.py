import rig

from humanoid_sim.messages import Intent, TickOutput
from humanoid_sim.session.device_watch import DeviceWatch


class Watched:
    def __init__(self) -> None:
        self.heard: dict[str, float] = {}
        self.told: list[str] = []
        self.watch = DeviceWatch("gamepad", lambda: self.heard, self.told.append)
        self.run = rig.Run(rig.supervisor())
        self.output: TickOutput | None = None

    def tick(self, *intents: Intent) -> tuple[Intent, ...]:
        found = tuple(self.watch.poll(self.run.time, self.output))
        self.output = self.run.step(*intents, *found)
        return found

    def beat(self) -> None:
        self.heard["gamepad"] = self.run.time


def test_a_device_that_was_never_there_asks_for_nothing() -> None:
    watched = Watched()
    watched.heard["another"] = 0.0
    assert [watched.tick() for _ in range(50)] == [()] * 50


def test_a_device_that_was_never_there_lets_nothing_drive_the_joints() -> None:
    watched = Watched()
    watched.tick(Intent.DAMP)
    watched.tick(Intent.LOAD_A)
    assert watched.tick() == (Intent.DAMP,)
    assert watched.told == ["gamepad: lost, never heard: DAMP"]
    assert watched.tick() == ()


def test_its_loss_is_a_damp_in_every_mode_within_its_timeout() -> None:
    for controller, path in rig.PATHS.items():
        watched = Watched()
        watched.tick()
        for intent in path:
            watched.beat()
            watched.tick(intent)
            for _ in range(6):
                watched.beat()
                watched.tick()
        if controller != "rl_policy_controller":  # it faults without the velocity that it observes
            assert watched.output.control_mode.controller_name == controller
        last = watched.run.time
        watched.beat()
        while not watched.tick():
            assert watched.run.time - last < 1.0
        assert watched.run.time - last <= 0.2 + 2 * rig.PERIOD + 1e-9
        assert watched.output.control_mode.controller_name == "damping_controller"
        assert watched.told == ["gamepad: lost, nothing heard for 0.2 s: DAMP"]


def test_without_it_nothing_leaves_damping_and_with_it_again_the_operator_may() -> None:
    watched = Watched()
    watched.beat()
    watched.tick(Intent.DAMP)
    for _ in range(20):
        watched.tick()
    watched.tick(Intent.LOAD_A)
    assert watched.tick() == (Intent.DAMP,)
    assert watched.output.control_mode.controller_name == "damping_controller"
    assert watched.tick() == ()
    watched.beat()
    assert watched.tick(Intent.LOAD_A) == ()
    assert watched.output.control_mode.controller_name == "standby_controller_a"
    assert watched.told[-1] == "gamepad: there again"


def test_a_clock_that_is_no_number_counts_as_a_loss() -> None:
    watched = Watched()
    watched.beat()
    watched.tick(Intent.DAMP)
    watched.heard["gamepad"] = float("nan")
    assert watched.tick() == (Intent.DAMP,)


def test_heartbeats_that_waited_while_motors_were_enabled_are_no_loss() -> None:
    watched = Watched()
    watched.beat()
    watched.run.time += 7.0
    assert watched.tick() == ()
    watched.beat()
    watched.run.time += 7.0  # enabled afresh
    assert watched.tick() == ()
    silent = watched.run.time
    while not watched.tick():
        assert watched.run.time - silent < 0.3
    assert watched.told == ["gamepad: lost, nothing heard for 0.2 s: DAMP"]
    watched.run.time += 7.0
    watched.tick()
    assert watched.told == ["gamepad: lost, nothing heard for 0.2 s: DAMP"], "nor is one that is lost there again by it"
