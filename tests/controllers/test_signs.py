"""The signs: what is found of mirrored and shifted joints of an arm that hangs, and what becomes of START then."""

from dataclasses import replace

import numpy as np
import pytest
import rig

from humanoid_sim.controllers.signs import AGREES, CONTRADICTS, LEVER_COLUMNS, UNDECIDED, Signs
from humanoid_sim.errors import FieldError
from humanoid_sim.messages import Intent, Mode, TickInput
from humanoid_sim.mit import GRAVITY_LEVERS, Extern, MITCommand
from humanoid_sim.testing import fingerprint, healthy_state

POSE = np.array([0.5, 0.8, 0.3])
WEIGHT, LENGTH, TOLERANCE = np.array([30.0, 20.0, 0.3]), 0.4, 0.5
"""N and m of each link of an arm in the vertical x-z plane whose joints turn about y; N·m."""
PERIOD = 0.02


def signs(*allowed):
    return Signs(rig.JOINTS, np.full(3, -2.0), np.full(3, 2.0), allowed)


def torques(angles):
    """N·m that hold the arm, by hand: links at absolute angles from straight down, each heavy at its end."""
    absolute = np.cumsum(angles)
    reach = LENGTH * -np.sin(absolute)  # turning about y takes what hangs down backwards
    return np.array([-sum(WEIGHT[k] * reach[j : k + 1].sum() for k in range(j, 3)) for j in range(3)])


def levers(angles, *, ground=0.0):
    absolute = np.cumsum(angles)
    links = LENGTH * np.stack([-np.sin(absolute), np.zeros(3), -np.cos(absolute)], axis=-1)
    value = np.zeros((3, LEVER_COLUMNS))
    value[:, 1] = 1.0
    value[:, 3:6] = [sum(WEIGHT[k] * links[j : k + 1].sum(axis=0) for k in range(j, 3)) for j in range(3)]
    value[:, 6:10] = [[parent, TOLERANCE, TOLERANCE, ground] for parent in (-1, 0, 1)]
    return value


def hanging(time, angles=POSE, *, effort=None, **changes):
    """What a sound arm reports, with its levers."""
    state = replace(healthy_state(angles, time), joint_effort=torques(angles) if effort is None else effort)
    value = changes.pop("value", None)
    live = {GRAVITY_LEVERS: Extern(levers(angles) if value is None else value, time)}
    return replace(state, extern=live, **changes)


def mirrored(time, joint, angles=POSE):
    """What it reports if one joint is mirrored."""
    sign = np.where(np.arange(3) == joint, -1.0, 1.0)
    return hanging(time, angles, effort=sign * torques(sign * angles))


def shifted(time, joint, by):
    """What it reports if one joint reads too much."""
    return hanging(time, effort=torques(POSE - by * (np.arange(3) == joint)))


def command(pose=POSE):
    return MITCommand(pose, np.zeros(3), np.zeros(3), np.full(3, 50.0), np.ones(3))


def judged(judge, *states, is_finished=True):
    memory = None
    for state in states:
        memory = judge.watch(memory, state, command(state.joint_position), is_finished=is_finished)
    assert memory is not None
    return memory


def three(make, *arguments):
    return [make(0.1 * k, *arguments) for k in range(3)]


def test_the_levers_give_the_torques_that_were_computed_by_hand():
    value = levers(POSE)
    assert np.cross(value[:, :3], value[:, 3:6])[:, 2] == pytest.approx(torques(POSE))


def test_a_sound_arm_agrees_where_gravity_is_enough():
    memory = judged(signs(), *three(hanging))
    assert memory.verdict.tolist() == [AGREES, AGREES, UNDECIDED], "the wrist weighs too little"
    assert (memory.refusal, memory.notice) == ("", "signs: 2 of 3 joints agree with gravity, 1 not decidable")
    assert memory.is_ready


@pytest.mark.parametrize("joint", [0, 1])
def test_a_mirrored_joint_is_named_and_refused(joint):
    memory = judged(signs(), *three(mirrored, joint))
    assert (memory.verdict == CONTRADICTS).sum() == 1
    assert memory.refusal.startswith("shoulder contradicts gravity: held with "), "it is held most wrongly"
    assert "rad, where its readings need 17.6; its direction explains that" in memory.refusal
    assert ", that of elbow would too" in memory.refusal, "all links turn in one plane"
    assert memory.notice.startswith(memory.refusal)


def test_a_mirrored_joint_that_is_allowed_is_only_told():
    memory = judged(signs("elbow"), *three(mirrored, 1))
    assert memory.refusal == ""
    assert "that of elbow would too" in memory.notice
    assert judged(signs("wrist"), *three(mirrored, 1)).refusal


@pytest.mark.parametrize(("joint", "by"), [(0, 0.6), (0, -0.6), (1, 0.6)])
def test_an_offset_is_named_and_only_told(joint, by):
    memory = judged(signs(), *three(shifted, joint, by))
    assert memory.refusal == ""
    assert memory.verdict[joint] == CONTRADICTS
    assert memory.notice.split("; ")[1].startswith(f"{rig.JOINTS[joint]} contradicts gravity")
    assert f"a homing offset that is off by about {by:.1f} rad explains that" in memory.notice


def test_what_no_single_fault_explains_is_only_told():
    wrong = torques(POSE) + np.array([40.0, -30.0, 9.0])
    memory = judged(signs(), *[hanging(0.1 * k, effort=wrong) for k in range(3)])
    assert memory.refusal == ""
    assert "no single direction or offset explains that" in memory.notice
    assert (memory.verdict == UNDECIDED).all(), "no joint of it agrees with gravity"


def test_what_is_within_the_tolerance_accuses_nobody():
    for side in (-1.0, 1.0):
        effort = torques(POSE) + side * TOLERANCE
        memory = judged(signs(), *[hanging(0.1 * k, effort=effort) for k in range(3)])
        assert "contradicts" not in memory.notice


def test_a_joint_at_its_stop_may_be_pressed():
    pose = np.array([0.5, 2.0, 0.3])
    pressed = torques(pose) + np.array([0.0, 30.0, 0.0])
    for effort, is_accused in ((pressed, False), (2.0 * torques(pose) - pressed, True)):
        memory = judged(signs(), *[hanging(0.1 * k, pose, effort=effort) for k in range(3)])
        assert ("contradicts" in memory.notice) is is_accused


def test_joints_that_move_or_are_silent_are_not_judged():
    moving = [mirrored(0.1 * k, 1, POSE + 0.05 * k) for k in range(9)]
    silent = [replace(mirrored(0.1 * k, 1), joint_age=np.array([0.0, 0.0, 0.2])) for k in range(9)]
    for states in (moving, silent):
        memory = judged(signs(), *states)
        assert (memory.verdict == UNDECIDED).all()
        assert (memory.refusal, memory.notice) == ("", "")
        assert not memory.is_ready
        assert judged(signs(), *states, replace(states[-1], time=1.2, extern=hanging(1.2).extern)).is_ready, "in vain"


def test_two_limbs_at_once_stand_on_the_ground_and_one_is_at_fault():
    """Three legs of one joint each."""
    value = levers(POSE, ground=1.0)
    value[:, 6] = -1.0
    value[:, 3:6] = [[-5.0, 0.0, -2.0]] * 3
    sound = np.cross(value[:, :3], value[:, 3:6])[:, 2]
    for wrong, refused in (([1.0, -1.0, -1.0], False), ([1.0, -1.0, 1.0], True)):
        states = [hanging(0.1 * k, np.array([0.0, 0.1, 0.1]), effort=sound * wrong, value=value) for k in range(3)]
        memory = judged(signs(), *states)
        assert bool(memory.refusal) is refused
        assert ("lift the robot" in memory.notice) is not refused


def test_poses_add_up():
    """Straight down nothing is decidable; what was seen before stays."""
    down = [hanging(0.1 * k, np.zeros(3)) for k in range(3)]
    memory = judged(signs(), *down)
    assert (memory.verdict == UNDECIDED).all()
    later = [mirrored(0.3 + 0.1 * k, 1) for k in range(3)]
    again = [hanging(0.6 + 0.1 * k, np.zeros(3)) for k in range(3)]
    assert judged(signs(), *down, *later, *again).refusal.startswith("shoulder contradicts")


@pytest.mark.parametrize(
    "live",
    [
        {},
        {GRAVITY_LEVERS: Extern(levers(POSE), -0.1)},
        {GRAVITY_LEVERS: Extern(np.full((3, LEVER_COLUMNS), np.nan), 0.0)},
        {GRAVITY_LEVERS: Extern(np.zeros((2, LEVER_COLUMNS)), 0.0)},
    ],
    ids=["none", "old", "not finite", "of another robot"],
)
def test_a_tick_that_is_no_sample_changes_nothing(live):
    memory = judged(signs(), hanging(-0.2))
    state = replace(healthy_state(POSE, 0.0), extern=live)
    assert signs().watch(memory, state, command(), is_finished=True) is memory
    assert signs().watch(None, state, command(), is_finished=True) is None


def test_parents_that_make_no_tree_do_no_harm():
    value = levers(POSE)
    value[:, 6] = [2.0, 0.0, 1.0]
    assert judged(signs(), *[hanging(0.1 * k, value=value) for k in range(3)]).is_ready
    value[:, 6] = [7.0, -3.0, 1e12]
    assert judged(signs(), *[hanging(0.1 * k, value=value) for k in range(3)]).is_ready


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"lower": np.zeros(2)}, "Signs.lower: is [0. 0.], expected 3 numbers, one per joint"),
        ({"upper": np.full(3, np.nan)}, "Signs.upper: is [nan nan nan], expected 3 numbers, one per joint"),
        ({"allowed": ("elbo",)}, "Signs.allowed: unknown joint 'elbo'"),
    ],
)
def test_what_is_refused(changes, message):
    values = {"joints": rig.JOINTS, "lower": np.zeros(3), "upper": np.ones(3)}
    with pytest.raises(FieldError) as caught:
        Signs(**{**values, **changes})
    assert str(caught.value).startswith(message)


class Bench:
    """A control stack that judges signs, on an arm that stays where it is told to be, or with a mirrored joint."""

    def __init__(self, joint, *allowed):
        self.stack = replace(rig.supervisor(), signs=signs(*allowed))
        self.memory = self.stack.initial()
        self.time, self.joint = 0.0, joint
        self.outputs = []
        self.inputs = []

    def run(self, ticks, *intents):
        for k in range(ticks):
            state = mirrored(self.time, self.joint) if self.joint is not None else hanging(self.time)
            if round(self.time / PERIOD) % 5:
                state = replace(state, extern={})
            given = TickInput(state, intents=intents if k == 0 else ())
            self.memory, output = self.stack.step(self.memory, given)
            self.inputs.append(given)
            self.outputs.append(output)
            self.time += PERIOD
        return self.outputs[-1]

    def reach(self, ticks=40):
        self.run(2, Intent.DAMP)
        return self.run(ticks, Intent.LOAD_A)


@pytest.mark.parametrize("intent", [Intent.START_LOCOMOTION, Intent.START_REMOTE])
def test_start_is_refused_and_granted_to_who_knows_better(intent):
    bench = Bench(1)
    bench.reach()
    output = bench.run(1, intent)
    assert output.control_mode.mode is Mode.STANDBY
    assert output.refusals[0].startswith(f"{intent.name} refused: shoulder contradicts gravity: held with ")
    for sound in (Bench(1, "elbow"), Bench(None)):
        sound.reach()
        assert sound.run(1, intent).control_mode.mode in (Mode.LOCOMOTION, Mode.REMOTE, Mode.DAMPING)
        assert not sound.outputs[-1].refusals


def test_standby_finishes_with_the_verdict_and_without_samples_at_once():
    bench = Bench(None)
    bench.reach()
    finished = next(i for i, output in enumerate(bench.outputs) if output.standby and output.standby.is_finished)
    told = next(i for i, o in enumerate(bench.outputs) if "2 of 3 joints agree" in o.control_mode.status_message)
    assert finished == told
    assert not bench.run(1, Intent.START_REMOTE).refusals
    assert bench.memory.signs is None, "forgotten with STANDBY"
    blind = Bench(1)
    blind.stack = rig.supervisor()
    blind.reach(8)
    assert not blind.run(1, Intent.START_REMOTE).refusals, "without signs the levers are ignored"


def test_the_same_inputs_give_the_same_bits():
    bench = Bench(1)
    bench.reach()
    memory = bench.stack.initial()
    for given, output in zip(bench.inputs, bench.outputs, strict=True):
        memory, again = bench.stack.step(memory, given)
        assert fingerprint(again) == fingerprint(output)
