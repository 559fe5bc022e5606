from humanoid_sim.evaluation.failure import DEFINITIONS, differing


def test_definitions_name_their_numbers():
    assert "below 0.6 of the height" in DEFINITIONS["fall"]
    assert "more than 1 rad" in DEFINITIONS["fall"]
    assert "0.3 m from the motion" in DEFINITIONS["loss"]
    assert "0.35 m off its height or leans by more than 1.2 rad" in DEFINITIONS["loss"]


def test_what_differs_is_named():
    assert differing(DEFINITIONS) == ()
    assert differing({**DEFINITIONS, "loss": "it is out of sight"}) == ("loss",)
    assert differing({}) == ("fall", "loss", "errors")
    assert differing({**DEFINITIONS, "more": "than there is today"}) == ()
