"""Numbers of the results as a person reads them."""

import msgspec

from humanoid_sim.regress import results


def test_what_makes_a_metric_worse_whatever_its_mean():
    case = results.CaseComparison(
        case="wave",
        verdict="worse beyond tolerance",
        baseline=2.0,
        candidate=2.4,
        change=0.4,
    )
    same = msgspec.structs.replace(case, case="drum", verdict="no difference seen")
    comparison = results.Comparison(
        metric="joint_error",
        verdict="worse beyond tolerance",
        baseline=2.0,
        candidate=2.1,
        change=0.1,
        low=0.0,
        high=0.2,
        tolerance=0.1,
        episodes=8,
        paired=True,
        cases=(case, same),
    )
    assert comparison.reasons == "in wave by +20.0 %"
    assert msgspec.structs.replace(comparison, cases=(case, case)).reasons == ""  # the mean says it already
    failed = msgspec.structs.replace(comparison, cases=(), new_failures=tuple(f"wave, seed {i}" for i in range(5)))
    assert failed.reasons == "5 new: wave, seed 0; wave, seed 1; wave, seed 2 and 2 more"
