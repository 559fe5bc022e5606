"""The report: one file of tables that says what the results say."""

from xml.etree import ElementTree

from msgspec.structs import replace
from regress_runs import episode, run, tiny_suite, values

from humanoid_sim.regress.compare import judge
from humanoid_sim.regress.report import report_page
from humanoid_sim.regress.results import Results, SuiteInfo

SUITE = tiny_suite("ab", 6)
NONE = {"losses": 0.0, "faults": 0.0}


def results(candidate, baseline=None):
    return Results(
        suite=SuiteInfo(
            name="tiny",
            summary="arms <follow>",
            task="tracking",
            robot="lite",
            cases=("a", "b"),
            seeds=(0,),
            duration=1.0,
        ),
        metrics=SUITE.metrics,
        confidence=0.95,
        resamples=2000,
        baseline=baseline,
        candidates=(judge(SUITE, baseline, candidate),),
        arguments=("--suite", "my suite.yaml"),
    )


def steady(factor, name="policy"):
    return replace(values("joint_error", lambda _, seed: factor * (1.0 + 0.1 * seed), "ab", range(6)), name=name)


def texts(page, tag):
    """Texts of all elements of a kind; the page is well formed."""
    body = ElementTree.fromstring(page[page.index("<body>") : page.index("</html>")])
    return ["".join(element.itertext()) for element in body.iter(tag)]


def test_a_metric_that_is_worse_has_its_row_in_a_page_without_links():
    found = results(steady(1.2, "to<night>"), steady(1.0, "last week"))
    page = report_page(found)
    assert texts(page, "p")[1] == "FAILED"
    assert texts(page, "td")[:2] == ["joint_error", "worse beyond tolerance"]
    assert "+20.0 %" in texts(page, "td")
    assert texts(page, "h2")[0] == "to<night>"
    assert not {"script", "link", "img"} & {element.tag for element in ElementTree.fromstring(page[15:]).iter()}
    assert report_page(found) == page


def test_an_episode_that_failed_can_be_run_again_by_a_command():
    failed = run(
        [episode("a", 0, {"joint_error": 1.0} | NONE), episode("a", 1, {"joint_error": None} | NONE, "fell")], "nan"
    )
    page = report_page(results(failed))
    assert "a, seed 1, after 1.00 s: fell" in texts(page, "li")
    assert texts(page, "pre")[0].splitlines() == [
        "python -m humanoid_sim.regress nan.onnx --suite 'my suite.yaml' --episode a:1",
        "python -m humanoid_sim.replay runs/nan-a-1.mcap",
    ]
