from __future__ import annotations

from humanoid_sim.hardware.checks import CheckList, Verdict


def test_what_is_right_with_a_joint_is_one_line() -> None:
    checks = CheckList()
    checks.passed("left", "motor 11")
    checks.passed("right", "motor 21")
    checks.warn("left", "old firmware")
    checks.passed("left", "limits 17 N·m")
    assert [str(check) for check in checks.all] == [
        "left: motor 11; limits 17 N·m",
        "right: motor 21",
        "warning: left: old firmware",
    ]
    assert all(check.passed for check in checks.all)


def test_a_refusal_lists_every_problem() -> None:
    checks = CheckList("lite")
    checks.problem("left", "is missing")
    checks.passed("right", "motor 21")
    checks.problem("can0", "is down")
    assert checks.problems == ("left: is missing", "can0: is down")
    assert checks.refusal() == "lite: not enabled, 2 problems:\n  - left: is missing\n  - can0: is down"
    assert [check.verdict for check in checks.all] == [Verdict.PROBLEM, Verdict.PASSED, Verdict.PROBLEM]
