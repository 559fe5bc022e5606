"""What a person reads where episodes failed: of which the figures are."""

import io

from regress_runs import episode, run, tiny_suite
from rich.console import Console

from humanoid_sim.regress.compare import compare_runs
from humanoid_sim.regress.results import Candidate, Results, SuiteInfo
from humanoid_sim.regress.show import show_candidate, show_run
from humanoid_sim.regress.suite import Tolerance

SUITE = tiny_suite(joint_error=Tolerance(relative=0.05), faults=Tolerance())


def of(failed):
    whole = [episode("a", s, {"joint_error": 0.1, "faults": 0.0, "losses": 0.0}) for s in range(6 - failed)]
    lost = [episode("a", s, {"joint_error": None, "faults": 0.0, "losses": 0.0}, "fell") for s in range(6 - failed, 6)]
    return run([*whole, *lost])


def shown(candidate, baseline=None):
    info = SuiteInfo(name="tiny", summary="", task="tracking", robot="lite", cases=("a",), seeds=(0,), duration=1.0)
    compared = () if baseline is None else compare_runs(SUITE, SUITE.metrics, baseline, candidate)
    beside = Candidate(run=candidate, passed=False, comparisons=compared)
    results = Results(
        suite=info,
        metrics=SUITE.metrics,
        confidence=0.95,
        resamples=2000,
        baseline=baseline,
        candidates=(beside,),
        strict=False,
    )
    console = Console(file=io.StringIO(), width=100)
    if baseline is None:
        show_run(console, results, candidate)
    else:
        show_candidate(console, results, beside)
    text = console.file.getvalue()
    return [line.strip() for line in text.splitlines()]


def test_errors_are_of_the_episodes_that_did_not_fail():
    told = "Errors are of the 4 episodes that did not fail."
    lines = shown(of(2))
    assert lines.index(told) == lines.index("2 of 6 episodes failed:") - 1
    assert not [line for line in shown(of(0)) + shown(of(6)) if line.startswith("Errors are")]


def test_pairs_that_are_left_out_stand_above_the_table():
    assert shown(of(2), of(0))[0] == "without 2 of 6 pairs in which an episode failed: joint_error"
    assert not [line for line in shown(of(0), of(0)) if line.startswith("without")]
