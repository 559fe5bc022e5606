"""Results with known content: what the policies did is drawn from seeded generators, what is said of it is computed."""

from dataclasses import dataclass, field

import numpy as np

from humanoid_sim.regress.compare import compare_runs, detectable_changes
from humanoid_sim.regress.results import Candidate, Episode, Margin, MarginComparison, PolicyRun, Results, SuiteInfo
from humanoid_sim.regress.suite import load_suite

SUITE, _ = load_suite("lite_tracking")
CASES = tuple(case.name for case in SUITE.cases)
DURATION = 8.0
POINTS = 120
USUAL = {
    "body_position_error": 0.012,
    "body_orientation_error": 0.05,
    "joint_error": 0.03,
    "effort": 2.4,
    "action_rate": 1.1,
}
SHOWN = ("body_position_error", "effort", "action_rate", "losses")
TRACED = ("body_position_error", "body_orientation_error", "joint_error", "effort")


@dataclass
class Behaviour:
    """What an invented policy does, beside the usual."""

    name: str = "tonight"
    factors: dict[str, float] = field(default_factory=dict)
    """By metric, on every case."""
    bad_case: str = ""
    """Where its body position error is half as large again."""
    failing: tuple[tuple[str, int], ...] = ()
    """Case and seed of the episodes that it loses after 3 s."""
    faulty: tuple[tuple[str, int], ...] = ()


def seeds(first: int = 0, count: int = 12) -> tuple[int, ...]:
    return tuple(range(first, first + count))


def episode(case: str, seed: int, behaviour: Behaviour) -> Episode:
    shared = np.random.default_rng([CASES.index(case), seed])
    own = np.random.default_rng([CASES.index(case), seed, len(behaviour.name), sum(map(ord, behaviour.name))])
    lost, faulty = (case, seed) in behaviour.failing, (case, seed) in behaviour.faulty
    lasted = 3.0 if lost else 1.0 if faulty else DURATION
    times = (np.arange(POINTS) + 0.5) * lasted / POINTS
    luck = 1.0 + 0.12 * shared.normal() + 0.3 * CASES.index(case) / len(CASES)
    metrics, traces = {}, {}
    for name, usual in USUAL.items():
        factor = behaviour.factors.get(name, 1.0)
        if name == "body_position_error" and case == behaviour.bad_case:
            factor *= 1.5
        shape = 1.0 + 0.5 * np.sin(2.0 * times + CASES.index(case)) ** 2 + 0.05 * own.normal(size=POINTS)
        values = usual * luck * factor * shape * (1.0 + (times / lasted) ** 6 * 4.0 * lost)
        metrics[name] = float(np.sqrt((values * values).mean()))
        if name in TRACED:
            traces[name] = tuple(values.tolist())
    if lost or faulty:
        metrics = dict.fromkeys(metrics)
    metrics |= {"losses": float(lost), "faults": float(faulty), "survival": lasted / DURATION}
    failure = "tracked bodies are 0.31 m from the motion" if lost else "action of left_elbow_pitch is nan" * faulty
    return Episode(
        case=case,
        seed=seed,
        steps=round(lasted / 0.02),
        duration=lasted,
        failure=failure,
        kind="lost" if lost else "fault" if faulty else "",
        metrics=metrics,
        trace_times=tuple(times.tolist()),
        traces=traces,
    )


def margins(limit_delay: float = 0.02) -> tuple[Margin, ...]:
    def sweep(axis: str, unit: str, nominal: float, levels: tuple[float, ...], limit: float) -> Margin:
        beyond = [level for level in levels if abs(level - nominal) > abs(limit - nominal)]
        return Margin(
            axis=axis,
            unit=unit,
            nominal=nominal,
            limit=limit,
            reached_end=not beyond,
            failure="strayed" if beyond else "",
            levels=levels,
            failed_share=tuple(0.6 if level in beyond else 0.0 for level in levels),
        )

    return (
        sweep("delay", "s", 0.0, (0.005, 0.01, 0.02, 0.04), limit_delay),
        sweep("gains down", "×", 1.0, (0.8, 0.6, 0.4), 0.6),
        sweep("gains up", "×", 1.0, (1.25, 1.5, 2.0), 2.0),
        sweep("noise", "rad", 0.0, (0.005, 0.01, 0.02), 0.01),
    )


def run(behaviour: Behaviour, wanted: tuple[int, ...] = seeds(), with_margins: bool = False) -> PolicyRun:
    return PolicyRun(
        name=behaviour.name,
        source=f"{behaviour.name}.onnx",
        sha256="0123456789abcdef" * 4,
        suite=SUITE.name,
        case_digests=dict.fromkeys(CASES, "ab"),
        episodes=tuple(episode(case, seed, behaviour) for case in CASES for seed in wanted),
        margins=margins() if with_margins else (),
        batching="in batches",
        versions={"mujoco": "3.17.0", "onnxruntime": "1.31.1"},
    )


def results(*candidates: PolicyRun, baseline: PolicyRun | None = None) -> Results:
    metrics = tuple(metric for metric in SUITE.metrics if metric.name in SHOWN)
    compared = []
    for candidate in candidates:
        comparisons = compare_runs(SUITE, metrics, baseline, candidate) if baseline else ()
        against = tuple(
            MarginComparison(axis=m.axis, unit=m.unit, baseline=m.limit, candidate=m.limit, verdict="within tolerance")
            for m in candidate.margins
            if baseline and baseline.margins
        )
        passed = not any(comparison.verdict == "worse beyond tolerance" for comparison in comparisons)
        compared.append(Candidate(run=candidate, passed=passed, comparisons=comparisons, margins=against))
    return Results(
        suite=SuiteInfo(
            name=SUITE.name,
            summary=SUITE.summary,
            task="tracking",
            robot="lite",
            cases=CASES,
            seeds=tuple(dict.fromkeys(e.seed for e in candidates[0].episodes)),
            duration=DURATION,
            policy_dt=0.02,
        ),
        metrics=metrics,
        confidence=SUITE.confidence,
        resamples=SUITE.resamples,
        baseline=baseline,
        detectable=detectable_changes(SUITE, metrics, baseline) if baseline else (),
        candidates=tuple(compared),
    )


def worse(with_margins: bool = False) -> Results:
    """The candidate is worse in one case, loses two episodes, refuses in another, and moves less jerkily."""
    behaviour = Behaviour(
        factors={"action_rate": 0.8, "effort": 1.01},
        bad_case="circle",
        failing=(("circle", 3), ("drum", 7)),
        faulty=(("wave", 1),),
    )
    old = run(Behaviour(name="last week"), with_margins=with_margins)
    return results(run(behaviour, with_margins=with_margins), baseline=old)
