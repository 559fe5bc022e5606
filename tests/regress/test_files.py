"""Results on disk: baselines, and JUnit XML that continuous integration understands."""

from xml.etree import ElementTree

import pytest
from msgspec.structs import replace
from regress_runs import episode, run, tiny_suite

from humanoid_sim.errors import InputError
from humanoid_sim.regress.compare import compare_runs
from humanoid_sim.regress.files import json_of, junit_xml, read_baseline
from humanoid_sim.regress.results import Candidate, Results, SuiteInfo
from humanoid_sim.regress.suite import Tolerance

SUITE = tiny_suite(joint_error=Tolerance(relative=0.05), effort=Tolerance(), faults=Tolerance())


def results(factor, *, baseline=True, strict=False):
    good = run(episode("a", s, {"joint_error": 0.1, "effort": None, "faults": 0.0}) for s in range(6))
    failed = episode("a", 5, {"joint_error": None, "effort": None, "faults": 0.0}, "strayed: \x00 <left_hand> & more")
    other = run(
        [*(episode("a", s, {"joint_error": 0.1 * factor, "effort": None, "faults": 0.0}) for s in range(5)), failed],
        "new <policy>",
    )
    candidate = Candidate(
        run=other,
        passed=False,
        comparisons=compare_runs(SUITE, SUITE.metrics, good, other) if baseline else (),
    )
    info = SuiteInfo(name="tiny", summary="", task="tracking", robot="lite", cases=("a",), seeds=(0,), duration=1.0)
    return Results(
        suite=info,
        metrics=SUITE.metrics,
        confidence=0.95,
        resamples=2000,
        baseline=good if baseline else None,
        candidates=(candidate,),
        strict=strict,
    )


def test_a_regression_is_a_failure_that_names_the_metric():
    root = ElementTree.fromstring(junit_xml(results(1.2)))
    assert root.attrib == {"name": "regress tiny", "tests": "4", "failures": "1", "skipped": "2"}
    cases = {case.get("name"): case for case in root.iter("testcase")}
    assert list(cases) == ["joint_error", "effort", "faults", "losses"]
    failure = cases["joint_error"].find("failure")
    assert failure.get("message") == (
        "joint_error: worse beyond tolerance: 6.88°, was 5.73°: +1.15° (+20.0 %), between +1.15° and +1.15°; "
        "tolerated: 0.286°; without 1 of 6 pairs in which an episode failed"
    )
    skipped = cases["effort"].find("skipped")
    assert skipped.get("message") == "no episodes to compare"
    assert cases["faults"].find("failure") is None


def test_round_trip(tmp_path):
    written = run([episode("a", 0, {"joint_error": 0.1, "effort": None}), episode("a", 1, {}, "fell")])
    (tmp_path / "base.json").write_bytes(json_of(written))
    assert read_baseline(tmp_path / "base.json") == written
    assert b'"joint_error": 0.1' in (tmp_path / "base.json").read_bytes()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is not a baseline of `regress --write-baseline`"),
        ("[1]", r"is not a baseline.*Expected `object`, got `array`"),
        ('{"name": 1}', r"is not a baseline.*Expected `str`, got `int` - at `\$.name`"),
        ('{"format": "humanoid_sim.regress/9"}', "is not a baseline.*humanoid_sim.regress/9"),
    ],
)
def test_what_is_no_baseline(tmp_path, text, message):
    path = tmp_path / "base.json"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as error:
        read_baseline(path)
    assert str(error.value).startswith(f"{path}: ")


def test_what_is_unclear_fails_where_it_has_to_be_clear():
    for strict, failures in ((False, 0), (True, 1)):
        whole = results(1.0, strict=strict)
        candidate = whole.candidates[0]
        unclear = replace(candidate.comparisons[0], verdict="unclear")
        whole = replace(whole, candidates=(replace(candidate, comparisons=(unclear, *candidate.comparisons[1:])),))
        found = list(ElementTree.fromstring(junit_xml(whole)).iter("failure"))
        assert len(found) == failures
        assert all((failure.get("message") or "").startswith("joint_error: unclear: ") for failure in found)
        few = replace(whole, candidates=(replace(whole.candidates[0], few_seeds=2),))
        assert len(list(ElementTree.fromstring(junit_xml(few)).iter("failure"))) == 1
