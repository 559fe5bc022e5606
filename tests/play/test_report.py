import json

from humanoid_sim.play.report import write_summary


def test_a_summary_is_json_as_the_standard_has_it(tmp_path):
    path = tmp_path / "s.json"
    write_summary(path, {"a": float("nan"), "b": [1.5, (float("inf"), 2)], "c": {"d": None, "e": True, "f": "nan"}})

    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")

    summary = json.loads(path.read_text(), parse_constant=refuse)
    assert summary == {"a": None, "b": [1.5, [None, 2]], "c": {"d": None, "e": True, "f": "nan"}}
