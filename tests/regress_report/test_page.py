"""The report as a whole: one file, well formed, the same every time, saying what the results say."""

import re
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import invented
import msgspec
import pytest
from invented import Behaviour
from rich.console import Console

from humanoid_sim.errors import MissingPackageError
from humanoid_sim.regress import run
from humanoid_sim.regress.options import RegressConfig
from humanoid_sim.regress.report.page import Picture, interval_bar, report_page, scale_end, worst_moment
from humanoid_sim.regress.report.plots import LIGHT
from humanoid_sim.regress.results import Comparison, MetricInfo

VOID = {"img", "meta", "br"}


class Page(HTMLParser):
    """Checks that elements nest, and keeps what a test may ask for."""

    def __init__(self, html):
        super().__init__()
        self.open = []
        self.ids = []
        self.links = []
        self.elements = []
        self.words = []
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.elements.append(tag)
        for name, value in attrs:
            if name == "id":
                self.ids.append(value)
            if name in ("src", "href", "xlink:href") and value:
                self.links.append(value)
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if not self.open or self.open[-1] != "style":
            self.words.append(data)

    @property
    def text(self):
        return re.sub(r"\s+", " ", " ".join(self.words))


@pytest.fixture(scope="module")
def worse_html():
    return report_page(invented.worse(with_margins=True))


@pytest.fixture(scope="module")
def worse_page(worse_html):
    return Page(worse_html)


def test_the_page_needs_nothing_else(worse_html, worse_page):
    assert all(link.startswith(("#", "data:image/png;base64,")) for link in worse_page.links)
    assert not {"script", "link", "img", "iframe", "object"} & set(worse_page.elements)
    assert "@import" not in worse_html
    assert not [url for url in re.findall(r"url\(([^)]*)\)", worse_html) if not url.startswith("#")]
    addresses = set(re.findall(r"https?://[^\"'\s<>]+", worse_html))
    assert addresses <= {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}


def test_names_are_unique_and_every_reference_has_its_target(worse_html, worse_page):
    assert len(set(worse_page.ids)) == len(worse_page.ids)
    targets = set(re.findall(r"url\(#([^)]*)\)", worse_html)) | {link[1:] for link in worse_page.links}
    assert targets
    assert targets <= set(worse_page.ids)


def test_every_svg_is_well_formed(worse_html):
    found = re.findall(r"<svg.*?</svg>", worse_html, re.DOTALL)
    assert len(found) == 1 + 4 + 1 + 1 + 1  # scale, bars, cases, traces, margins
    for svg in found:
        root = ElementTree.fromstring(svg)
        assert root.get("aria-label")
        assert root.get("viewBox")


def test_the_page_follows_a_dark_system(worse_html):
    body = worse_html.partition("</style>")[2]
    assert "prefers-color-scheme: dark" in worse_html
    assert not set(re.findall(r"#[0-9a-f]{6}", body))
    assert set(re.findall(r"var\(--(\w+)\)", worse_html)) <= set(LIGHT)


def test_verdicts_come_first(worse_page):
    text = worse_page.text
    headings = ("FAILED", "detectable", "What moved, by case", "Worst episodes", "Margins", "What was run")
    assert sorted(headings, key=text.index) == list(headings)
    assert "tonight against last week: failed; 3 of 48 episodes failed." in text
    assert (
        "worse beyond tolerance body position error +13.6 % (+12.5 to +15.0 %; in circle by +50.2 %), losses " in text
    )
    assert "; 2 new: circle, seed 3; drum, seed 7)" in text


def test_the_verdict_table_holds_every_metric(worse_html):
    results = invented.worse(with_margins=True)
    table = worse_html[worse_html.index('id="verdict-0"') : worse_html.index('id="cases"')]
    rows = re.findall(r"<tr>(?:(?!</tr>).)*</tr>", table, re.DOTALL)[1:]
    assert len(rows) == len(results.metrics)
    for row, comparison in zip(rows, results.candidates[0].comparisons, strict=True):
        assert comparison.metric.replace("_", " ") in row
        assert f">{comparison.verdict}</span>" in row
    assert "17.1 mm" in rows[0]
    assert "+13.6 %" in rows[0]
    assert re.findall(r'number">([^<]*)</td></tr>', rows[0]) == ["6.6 %"]


def test_the_worst_episodes_are_named(worse_html):
    table = worse_html[worse_html.index('id="worst-0"') : worse_html.index('id="margins"')]
    rows = [re.findall(r"<td[^>]*>(.*?)</td>", row) for row in re.findall(r"<tr>.*?</tr>", table, re.DOTALL)][1:]
    assert [(row[0], row[1]) for row in rows[:3]] == [("wave", "1"), ("circle", "3"), ("drum", "7")]
    assert rows[0][6] == "action of left_elbow_pitch is nan"
    assert {row[0] for row in rows[3:]} == {"circle"}
    assert len(rows) == 10


def test_the_worst_episode_can_be_run_again_by_a_command(worse_html):
    results = msgspec.structs.replace(
        invented.worse(), arguments=("--suite", "my suite.yaml"), warnings=("2 seeds of each case are few",)
    )
    html = report_page(results, [[Picture("tonight at 1.00 s", "data:image/png;base64,iVBORw==")]])
    assert (
        "python -m humanoid_sim.regress tonight.onnx --suite &#39;my suite.yaml&#39; --episode wave:1\n"
        "python -m humanoid_sim.replay runs/tonight-wave-1.mcap\n"
        "python -m humanoid_sim.play --again runs/tonight-wave-1.mcap</code>"
    ) in html
    assert '<img alt="wave, seed 1: tonight at 1.00 s" src="data:image/png;base64,iVBORw==">' in html
    assert "<img" not in worse_html
    assert "2 seeds of each case are few." in Page(html).text


def test_episodes_that_are_left_out_stand_below_the_verdicts(worse_page):
    assert "Without 3 of 48 pairs in which an episode failed: body position error, effort" in worse_page.text


def test_the_moment_of_the_worst_episode():
    effort = MetricInfo(name="effort", unit="N·m", better="lower", summary="Torque.")
    failed = invented.episode("wave", 1, Behaviour(faulty=(("wave", 1),)))
    assert worst_moment(failed, effort, 0.02) == failed.steps == 50
    whole = msgspec.structs.replace(
        invented.episode("wave", 1, Behaviour()), trace_times=(1.0, 2.0, 3.0), traces={"effort": (1.0, 4.0, None)}
    )
    assert worst_moment(whole, effort, 0.02) == 100
    assert worst_moment(whole, msgspec.structs.replace(effort, name="tilt"), 0.02) == whole.steps
    assert worst_moment(whole, msgspec.structs.replace(effort, better="higher"), 0.02) == 50


def test_only_what_moved_is_drawn_by_case(worse_html):
    figure = worse_html[worse_html.index('id="cases"') : worse_html.index('id="worst-0"')]
    titles = re.findall(r"change of [a-z ]+", figure)
    assert titles == [
        "change of body position error ",
        "change of losses ",
        "change of effort ",  # worse within tolerance
        "change of action rate ",
    ]
    assert "joint error" not in figure


def test_the_traces_are_those_of_the_first_of_the_worst(worse_page):
    """It failed in its first second, where the baseline's went on."""
    assert "wave, seed 1 : action of left_elbow_pitch is nan, after 1.00 s" in worse_page.text.replace("1:", "1 :")


def test_policies_that_do_the_same():
    old = invented.run(Behaviour(name="a"))
    same = msgspec.structs.replace(old, name="b")
    page = Page(report_page(invented.results(same, baseline=old)))
    assert "PASSED" in page.text
    assert "b against a: passed." in page.text
    assert "no difference seen body position error (seen from 5.0 %), effort (seen from 5.0 %), " in page.text
    assert "No trace of the first one differs from the baseline's" in page.text
    assert "cases" not in page.ids


def test_what_few_seeds_could_not_judge_is_undecided():
    old = invented.run(Behaviour(name="a"))
    found = invented.results(msgspec.structs.replace(old, name="b"), baseline=old)
    (candidate,) = found.candidates
    unclear = msgspec.structs.replace(candidate.comparisons[0], verdict="unclear")
    candidate = msgspec.structs.replace(
        candidate, passed=False, few_seeds=2, comparisons=(unclear, *candidate.comparisons[1:])
    )
    page = Page(report_page(msgspec.structs.replace(found, candidates=(candidate,))))
    assert "UNDECIDED" in page.text
    assert "PASSED" not in page.text
    assert "FAILED" not in page.text
    assert "b against a: undecided; 2 seeds are too few to judge body position error." in page.text


def test_without_matplotlib_one_line_says_what_to_install(monkeypatch):
    monkeypatch.setattr(run, "find_spec", lambda _: None)
    with pytest.raises(MissingPackageError, match=r"--report needs the package 'matplotlib'.*humanoid_sim\[report\]"):
        run.tested(RegressConfig(("x.onnx",), report=Path("new.html")), Console())


ERROR = MetricInfo(name="error", unit="m", better="lower", summary="")
SURVIVAL = MetricInfo(name="survival", unit="share", better="higher", summary="")


def bar(metric, **changes):
    values = {
        "metric": metric.name,
        "verdict": "worse beyond tolerance",
        "baseline": 1.0,
        "candidate": 1.2,
        "change": 0.3,
        "low": 0.1,
        "high": 0.7,
        "tolerance": 0.1,
        "episodes": 8,
        "paired": True,
    }
    return interval_bar(metric, Comparison(**values | changes), 31.0)


def test_every_candidate_has_a_scale_that_holds_its_largest_change():
    def compared(high, tolerance=0.1):
        return Comparison(
            metric="error", verdict="no difference seen", baseline=1.0, candidate=1.0, change=0.0, low=-0.01, high=high,
            tolerance=tolerance, episodes=8, paired=True,
        )  # fmt: skip

    assert scale_end([]) == 3.0
    assert scale_end([compared(0.05), compared(0.29)]) == 3.0
    assert scale_end([compared(0.05), compared(0.31)]) == 10.0
    assert scale_end([compared(1.5)]) == 30.0
    assert scale_end([compared(1.5, tolerance=0.0)]) == 3.0  # of no tolerance there are no multiples
    assert scale_end([compared(1e9)]) == 1e6


def test_worse_lies_to_the_right_in_tolerances():
    """1, 3 and 7 tolerances lie 1, 2 and 3 fifths of the way to the end, which is at 31."""
    found = bar(ERROR)
    assert (found.left, found.change, found.right) == pytest.approx((20.0, 40.0, 60.0))
    found = bar(SURVIVAL)
    assert (found.left, found.change, found.right) == pytest.approx((-60.0, -40.0, -20.0))
    found = bar(SURVIVAL, change=-0.3, low=-0.7, high=0.1)
    assert (found.left, found.change, found.right) == pytest.approx((-20.0, 40.0, 60.0))
    assert bar(ERROR, high=1e6).right == 100.0


def test_a_bar_without_change_or_tolerance():
    assert bar(ERROR, change=None, low=None, high=None) is None
    nothing = bar(ERROR, change=0.0, low=0.0, high=0.0, tolerance=0.0, verdict="no difference seen")
    assert (nothing.left, nothing.change, nothing.right) == (0.0, 0.0, 0.0)
    assert bar(ERROR, tolerance=0.0).change == 100.0
