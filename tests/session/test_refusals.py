"""What was refused is counted whole, and told at a rate that a person can read."""

import os

from humanoid_sim.session.data_socket import Producer, Refusals

ONE, OTHER = Producer("one", 1), Producer("other", 2)


def test_each_reason_is_told_once_and_a_producer_at_most_once_a_second():
    told = []
    time = 0.0
    refusals = Refusals(lambda line: told.append((time, line)))
    for tick in range(1000):  # ten seconds at 100 Hz
        time = 0.01 * tick
        refusals.add(ONE, f"reason {tick // 200}")
        refusals.add(OTHER, "always the same")
        refusals.flush(time)
    assert refusals.count == 2000
    assert refusals.latest == "other (2): always the same"
    assert told == [
        (0.0, "refused of one (1): reason 0"),
        (0.0, "refused of other (2): always the same"),
        (2.0, "refused of one (1): reason 1"),
        (4.0, "refused of one (1): reason 2"),
        (6.0, "refused of one (1): reason 3"),
        (8.0, "refused of one (1): reason 4"),
    ]
    refusals.forget()
    assert refusals.lines == ()
    refusals.add(OTHER, "always the same")
    refusals.flush(9.5)
    assert told[-1][1] == "refused of other (2): always the same"


def test_what_came_too_fast_is_told_later_whoever_owns_meanwhile():
    told = []
    refusals = Refusals(told.append)
    for reason in "abc":
        refusals.add(ONE, reason)
    refusals.flush(5.0)
    assert told == ["refused of one (1): a"]
    refusals.forget()
    refusals.flush(5.99)
    refusals.flush(6.0)
    refusals.flush(1.0)  # the clock jumped back
    assert told == ["refused of one (1): a", "refused of one (1): b", "refused of one (1): c"]


def test_a_reason_is_one_line_that_steers_no_terminal():
    told = []
    refusals = Refusals(told.append)
    refusals.add(ONE, "joint_names are \x1b[2J\nerror: \x07" + "x" * 100_000)
    refusals.flush(0.0)
    assert told[0].startswith("refused of one (1): joint_names are ?[2J?error: ?xxx")
    assert len(told[0]) < 1100


def test_no_flood_of_reasons_is_remembered():
    refusals = Refusals(lambda _: None)
    for number in range(10_000):
        refusals.add(Producer("one", number), f"{number}")
        refusals.flush(0.0)
    assert refusals.count == 10_000
    assert (len(refusals.counts), refusals.counts["others"]) == (257, 9744)
    assert len(refusals.lines) == 256


def test_a_producer_reports_what_it_has_refused_itself(local):
    intake = local.intake("dds")
    intake.refused("/command: position has 3 values\n, expected 14", 3)
    local.tick()
    intake.refused("/command: another", 5)
    intake.refused("/command: another", 9)
    local.tick()
    intake.refused("/command: another", 9)  # nothing new
    local.tick()
    assert local.data.refusals.count == 9
    assert local.data.refusals.latest.endswith("): /command: another")
    assert [line for line in local.told if "position has 3 values , expected 14" in line]
    status = local.data.status()
    assert status["refused_samples"] == {f"dds ({os.getpid()})": 9}
    for total in (float("nan"), float("inf"), -1.0, 0.0):
        intake._send(4, "nonsense", (total,), None)
        local.tick()
    assert local.data.refusals.count == 13
    assert local.data.refusals.latest.endswith("a report of refusals without a number of them")
