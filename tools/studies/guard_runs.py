"""Record healthy and faulty runs of policies, and judge them with the guards under other rules.

    python -m tools.studies.guard_runs record FOLDER [POLICY ...]
    python -m tools.studies.guard_runs judge FOLDER [POLICY ...]

`record` simulates each policy once, guards off; `judge` replays what was recorded through `Guards.watch`, rule by rule,
and prints the table. The published policies are those that the tests use.
"""

import sys
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import msgspec
import numpy as np

sys.path.append(str(Path(__file__).parents[2] / "tests" / "policy"))

from published import HOLOSOMA_REST, POLICIES

from humanoid_sim.assets import policy_path
from humanoid_sim.controllers.guards import Guards
from humanoid_sim.envs.scenario import Scenario, make_scenario
from humanoid_sim.evaluation.rollout import ClosedLoop, sample_step
from humanoid_sim.mit import COMMAND_FIELDS, MITCommand, MITState
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.onnx_policy import OnnxPolicy
from humanoid_sim.regress.batched_policy import BatchedPolicy
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.guards import guards_of
from humanoid_sim.robots.schema import RobotDescription
from humanoid_sim.simulation.batch import BatchSimulation, Randomisation
from humanoid_sim.simulation.terrain import Terrain

G1 = "models/unitree_g1/scene.xml"
EFFORT = {
    "leg_": 20.0,
    "hip_roll": 139.0,
    "hip": 88.0,
    "knee": 139.0,
    "ankle": 50.0,
    "waist_yaw": 88.0,
    "waist": 50.0,
    "wrist_roll": 25.0,
    "wrist": 5.0,
    "shoulder": 25.0,
    "elbow": 25.0,
}
"""N·m, by the first part of a joint's name that fits, for scenes that give no limits: of Berkeley's legs as the
`robot.xml` of that project has them, of the G1 as mjlab's `g1_constants` and the scene that it exports."""
PLAYGROUND = """\
# What bh_policy.onnx does not say of itself.
task_type: locomotion
joint_names: [LL_HR, LL_HAA, LL_HFE, LL_KFE, LL_FFE, LL_FAA, LR_HR, LR_HAA, LR_HFE, LR_KFE, LR_FFE, LR_FAA]
joint_stiffness: [35, 35, 35, 35, 35, 1, 35, 35, 35, 35, 35, 1]
joint_damping: [1.5, 1.5, 1.5, 1.5, 1.5, 0.1, 1.5, 1.5, 1.5, 1.5, 1.5, 0.1]
model_joint_damping: drop
default_joint_pos: [-0.071, 0.103, -0.463, 0.983, -0.35, 0.126, 0.071, -0.103, -0.463, 0.983, -0.35, -0.126]
action_scale: 0.5
position_clip: joint_limits
policy_dt: 0.02
observation:
  - {name: base_lin_vel, at: imu}
  - base_ang_vel
  - projected_gravity
  - velocity_commands
  - joint_pos
  - joint_vel
  - actions
  - cos_phase
  - sin_phase
phase: {frequency: [[0, 1.5]], offsets: [0.0, 3.141592653589793], advance_first: false}
"""


@dataclass(frozen=True)
class Subject:
    """A policy, its robot, and what both can stand."""

    policy: str
    robot: str
    contract: str = ""
    """The text of a contract.yaml."""
    push: float = 0.5
    """m/s, withstood nearly always."""
    fast: float = 1.0
    """m/s forward."""
    action_limit: float | None = None


SUBJECTS = {
    "unitree": Subject("unitree_g1_velocity_v0/exported/policy.onnx", G1),
    "holosoma": Subject("holosoma_g1_loco/ppo_g1_29dof.onnx", G1, HOLOSOMA_REST),
    "waltz": Subject("beyondmimic_g1/Waltz.onnx", G1, push=0.3),
    "berkeley": Subject(
        "berkeley_humanoid_lite_biped_50hz/checkpoints/policy_biped_50hz.onnx",
        "models/berkeley_humanoid_lite_biped/scene.xml",
        push=0.15,
        fast=0.5,
    ),
    "playground": Subject(
        "playground_berkeley_humanoid/bh_policy.onnx",
        "models/playground_berkeley_humanoid/scene_native.xml",
        PLAYGROUND,
        push=0.3,
    ),
    "shipped": Subject("lite_biped_velocity", "lite_biped", push=0.25, fast=0.7),
}


@dataclass(frozen=True)
class Row:
    """One run."""

    name: str
    commands: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, 0.0),)
    """m/s, m/s, rad/s; one after the other, each for `CHANGE` s and the last on and on."""
    joint: int = -1
    fault: str = ""
    """`flip`, `offset`, `jam`, of that joint."""
    offset: float = 0.0
    onset: float = np.inf
    """s"""


CHANGE, HEALTHY, FAULTY = 2.0, 12.0, 8.0
"""s"""
COMMANDS = {
    "stand": (0.0, 0.0, 0.0),
    "forward": (0.5, 0.0, 0.0),
    "backward": (-0.4, 0.0, 0.0),
    "left": (0.0, 0.3, 0.0),
    "right": (0.0, -0.3, 0.0),
    "turn": (0.0, 0.0, 0.8),
    "turn back": (0.0, 0.0, -0.8),
    "curve": (0.4, 0.1, 0.5),
}
SUB = 2
"""Control periods in a policy step."""
SAME = Randomisation(
    mass=(0.95, 1.05),
    friction=(0.7, 1.2),
    stiffness=(0.97, 1.03),
    damping=(0.97, 1.03),
    joint_position_noise=0.002,
    joint_velocity_noise=0.05,
    angular_velocity_noise=0.02,
    orientation_noise=0.005,
)


def limited(robot: RobotDescription) -> RobotDescription:
    """Return the robot with the real one's effort limits, where its model has none."""
    if np.isfinite(robot.effort_limit).all():
        return robot
    efforts = (next(effort for part, effort in EFFORT.items() if part in joint.name) for joint in robot.joints)
    joints = (
        msgspec.structs.replace(joint, effort_limit=effort) for joint, effort in zip(robot.joints, efforts, strict=True)
    )
    return msgspec.structs.replace(robot, joints=tuple(joints))


class FaultyRobots:
    """Robots of a batch, some of whose joints are wired wrongly, or jam, from a moment on; all ticks are kept."""

    def __init__(self, simulation: BatchSimulation, rows: list[Row]) -> None:
        self.simulation, self.rows = simulation, rows
        n = len(simulation.joints)
        self.sign, self.offset = np.ones((len(rows), n)), np.zeros((len(rows), n))
        self.ticks: list[dict[str, np.ndarray]] = []
        self.tick = 0

    def state(self) -> MITState:
        """Return what the faulty joints report."""
        seen = self.simulation.state()
        return replace(
            seen,
            joint_position=self.sign * seen.joint_position + self.offset,
            joint_velocity=self.sign * seen.joint_velocity,
            joint_effort=self.sign * seen.joint_effort,
        )

    def step(self, command: MITCommand, *, wrench: Any = None, where: Any = None) -> None:
        """Do what a command asks for, for one policy step, beside a wrench on a body."""
        for _ in range(SUB):
            state = self.state()
            arrays = {
                "position": state.joint_position,
                "velocity": state.joint_velocity,
                "measured": state.joint_effort,
                "wanted": command.position,
            }
            self.ticks.append({name: array.astype(np.float32) for name, array in arrays.items()})
            applied = {name: getattr(command, name) for name in COMMAND_FIELDS}
            applied |= {name: self.sign * applied[name] for name in ("velocity", "effort")}
            applied["position"] = self.sign * (command.position - self.offset)
            self.simulation.step(MITCommand(**applied), where=where)
            self.tick += 1
        for i, row in enumerate(self.rows):
            if abs(self.tick * self.simulation.control_period - row.onset) < 1e-6:
                self.begin(i, row)

    def begin(self, i: int, row: Row) -> None:
        """Put the fault of a row in force."""
        if row.fault == "flip":
            self.sign[i, row.joint] = -1.0
        elif row.fault == "offset":
            self.offset[i, row.joint] = row.offset
        else:
            model = self.simulation.model(i)
            model.dof_damping[model.joint(self.simulation.joints[row.joint]).dofadr[0]] = 1e4


def without_ground(mjcf: Path, folder: Path) -> Path:
    """Copy a scene without its floor, so that it can stand on any."""
    tree = ElementTree.parse(mjcf)
    for part in tree.getroot().iter():
        for child in list(part):
            if child.get("type") == "plane" or (child.tag == "contact" and "floor" in child.get("geom2", "")):
                part.remove(child)
    copied = folder / f"{mjcf.parent.name}.xml"
    tree.write(copied)
    return copied


def scenario_of(subject: Subject, folder: Path, terrain: Terrain | None) -> tuple[Scenario, BatchedPolicy]:
    """Return a subject's scenario, on a terrain, and its policy."""
    path = policy_path(subject.policy) if "/" not in subject.policy else POLICIES / subject.policy
    robot = load_robot(subject.robot if "/" not in subject.robot else without_ground(POLICIES / subject.robot, folder))
    contract = None
    if subject.contract:
        contract = folder / "contract.yaml"
        contract.write_text(subject.contract, encoding="utf-8")
    checkpoint = load_checkpoint(path, contract, robot.joint_names)
    assert isinstance(checkpoint.policy, OnnxPolicy)
    made = make_scenario(
        checkpoint,
        limited(robot),
        checkpoint.motion,
        task="velocity" if checkpoint.contract.task_type == "locomotion" else "auto",
        actuation="implicit",
        terrain=terrain,
        joint_noise=0.02,
        velocity_noise=0.05,
        action_limit=subject.action_limit,
    )
    return made, BatchedPolicy(checkpoint.policy)


def batches(subject: Subject, joints: tuple[str, ...], tracks: bool) -> Iterator[tuple[str, list[Row], Any, Any]]:
    """Name, rows, terrain and push of each batch."""
    rng = np.random.default_rng(5)

    def changing(name: str) -> Row:
        return Row(name, tuple(list(COMMANDS.values())[i] for i in rng.integers(0, len(COMMANDS), 6)))

    steady = [Row(name, (command,)) for name, command in COMMANDS.items()]
    if tracks:
        steady = [Row(f"whole {i}") for i in range(4)]
        yield "level", steady, None, None
        yield "pushed", [Row(f"pushed {i}") for i in range(4)], None, (0.0, subject.push)
        yield "hard", [Row(f"pushed hard {i}") for i in range(4)], None, (1.0, 1.5)
    else:
        fast = Row("fast", ((subject.fast, 0.0, 0.0),))
        yield "level", [*steady, fast, *(changing(f"changing {i}") for i in range(3))], None, None
        pushed = [*steady, *(changing(f"changing {i}") for i in range(4))]
        yield "pushed", pushed, None, (0.5 * subject.push, subject.push)
        yield "hard", [steady[i] for i in (0, 1, 2, 3, 5, 7)], None, (3.0 * subject.push, 4.0 * subject.push)
        for kind in ("rough", "slopes", "steps"):
            ground = Terrain(kind, levels=1, variants=2, bump_height=0.03, slope=0.08, step_height=0.02)
            yield kind, [steady[i] for i in (0, 1, 2, 3, 4, 7)], ground, None
    faults = []
    for i, name in enumerate(joints):
        if any(part in name.lower() for part in ("shoulder", "elbow", "wrist", "waist")):
            continue
        kinds = [("flip", 0.0), ("offset", 0.4), ("offset", -0.4), ("jam", 0.0)]
        for fault, offset in kinds:
            onset = 0.02 * float(rng.integers(150, 200))
            asked = COMMANDS["forward"] if rng.random() < 0.7 else COMMANDS["turn"]
            faults.append(Row(f"{fault} {offset or ''} {name}", (asked,), i, fault, offset, onset))
    yield "faults", faults, None, None


def record(folder: Path, name: str) -> None:
    """Simulate a subject's runs, and store them."""
    subject = SUBJECTS[name]
    first, policy = scenario_of(subject, folder, None)
    contract = first.contract
    tracks = contract.task_type != "locomotion"
    for index, (batch, rows, terrain, push) in enumerate(batches(subject, first.description.joint_names, tracks)):
        started = time.monotonic()
        scenario = first if terrain is None else scenario_of(subject, folder, terrain)[0]
        count, task = len(rows), scenario.task
        steps = round((FAULTY if batch == "faults" else HEALTHY) / contract.policy_dt)
        simulation = BatchSimulation(
            scenario.description,
            count,
            control_period=contract.policy_dt / SUB,
            physics_timestep=scenario.physics_timestep,
            actuation="implicit",
            threads=1,
            anchor_body=contract.anchor_body,
            velocity_at=scenario.velocity_points,
            bodies=scenario.bodies,
            randomisation=SAME if push is None else replace(SAME, push=push, push_interval=2.0),
            terrain=terrain,
            seeds=1000 * index + np.arange(count),
        )
        with closing(simulation):
            start = task.start(np.stack([np.random.default_rng([index, i]).random(task.draws) for i in range(count)]))
            simulation.reset(
                joint_position=start.joint_position, joint_velocity=start.joint_velocity, base_yaw=start.base_yaw
            )
            robots = FaultyRobots(simulation, rows)
            velocity = np.array([row.commands[0] for row in rows])
            loop = ClosedLoop(robots, scenario.wiring, velocity)
            ends = np.full(count, steps)
            alive = np.ones(count, dtype=bool)
            command = None
            for step in range(steps):
                action, accepted = loop.infer(policy)
                action = np.where((alive & accepted)[:, None], action, loop.memory.last_action)
                which = int((step + 1) * contract.policy_dt / CHANGE)
                velocity = np.array([row.commands[min(which, len(row.commands) - 1)] for row in rows])
                command = loop.act(action, velocity=velocity, where=alive)
                lost = task.judge(sample_step(loop, simulation, np.full(count, step + 1))).terminated
                done = alive & (lost | simulation.fault | ~accepted)
                ends[done] = step + 1
                alive &= ~done
                if not alive.any():
                    break
        assert command is not None
        description = scenario.description
        ticks: dict[str, Any] = {key: np.stack([tick[key] for tick in robots.ticks]) for key in robots.ticks[0]}
        np.savez(
            folder / f"{name}.{batch}.npz",
            **ticks,
            ends=ends * SUB,
            fell=~alive,
            stiffness=command.stiffness[0],
            damping=command.damping[0],
            period=simulation.control_period,
            names=[row.name for row in rows],
            onset=[row.onset for row in rows],
            fault_joint=[row.joint for row in rows],
            joints=description.joint_names,
            robot=description.to_json(),
        )
        fell = " ".join(f"{ends[i] * contract.policy_dt:.1f}" for i in np.flatnonzero(~alive))
        print(
            f"{name} {batch}: {count} runs, fell {np.sum(~alive)}: {fell}; {time.monotonic() - started:.0f} s",
            flush=True,
        )


def rules(robot: RobotDescription) -> dict[str, Guards]:
    """Return what the table compares, by name; the last is what the package does."""
    guards = guards_of(robot)
    assert guards is not None
    trained = 0.8 * robot.effort_limit
    before = replace(guards, following_within=False, following_time=1.0, following_effort=trained)
    within = replace(before, following_within=True)
    return {
        "any command, 1 s": before,
        "within limits, 1 s": within,
        "within limits, 0.3 s": replace(within, following_time=0.3),
        "own effort limit, 0.5 s": replace(guards, following_time=0.5),
        "own effort limit, 0.4 s": replace(guards, following_time=0.4),
        "own effort limit, 0.3 s": guards,
    }


def trips(run: Any, guards: Guards) -> tuple[np.ndarray, list[str]]:
    """S at which each robot's guards first trip, infinity for never, and what they say."""
    count, n = run["position"].shape[1:]
    when, texts = np.full(count, np.inf), [""] * count
    memory, zeros = None, np.zeros((count, n))
    gains = (np.broadcast_to(run[name], (count, n)) for name in ("stiffness", "damping"))
    stiffness, damping = gains
    still = (np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)), np.zeros((count, 3)), np.zeros((count, 3)))
    for tick in range(len(run["position"])):
        # A robot that has fallen is not watched any more.
        over = (tick >= run["ends"])[:, None]
        position = np.where(over, np.nan, run["position"][tick].astype(float))
        velocity = np.where(over, np.nan, run["velocity"][tick].astype(float))
        state = MITState(tick * float(run["period"]), position, velocity, zeros, zeros, *still)
        command = MITCommand(run["wanted"][tick].astype(float), zeros, zeros, stiffness, damping)
        memory = guards.watch(memory, state, command)
        for i, text in guards.problems(memory, state, command).items():
            if when[i] == np.inf:
                when[i], texts[i] = tick * float(run["period"]), text
    return when, texts


def judge(folder: Path, names: list[str]) -> None:
    """Print the table of what the guards, under each rule, see in stored runs."""
    totals: dict[str, np.ndarray] = {}
    alarms = []
    for path in sorted(file for name in names for file in folder.glob(f"{name}.*.npz")):
        with np.load(path) as archive:
            run = dict(archive)
        has_faults = path.name.split(".")[1] == "faults"
        for rule, guards in rules(RobotDescription.from_json(str(run["robot"]))).items():
            when, texts = trips(run, guards)
            seen, fell = np.isfinite(when), run["fell"]
            early = np.flatnonzero(seen & (when < run["onset"]))
            alarms += [f"{rule}: {path.stem} {run['names'][i]} at {when[i]:.2f} s: {texts[i]}" for i in early]
            of_fault = seen & (when >= run["onset"])
            row = np.array(
                [(~fell).sum(), (seen & ~fell).sum(), fell.sum(), (seen & fell).sum(), 0, 0, 0, 0]
                if not has_faults
                else [0, (seen & ~of_fault).sum(), 0, 0, len(fell), of_fault.sum(), fell.sum(), (of_fault & fell).sum()]
            )
            totals[rule] = totals.get(rule, 0) + row
    print("| rule | healthy | alarms | healthy, fell | alarms | faults | seen | fell | seen before |")
    print("|---|---|---|---|---|---|---|---|---|")
    for rule, row in totals.items():
        print(f"| {rule} | {' | '.join(map(str, row))} |")
    print(*alarms, sep="\n")


if __name__ == "__main__":
    verb, where, *chosen = sys.argv[1:]
    if verb == "judge":
        judge(Path(where), chosen or list(SUBJECTS))
    else:
        Path(where).mkdir(parents=True, exist_ok=True)
        for each in chosen or SUBJECTS:
            record(Path(where), each)
