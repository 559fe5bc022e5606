from dataclasses import replace
from pathlib import Path

import pytest

from humanoid_sim.errors import InputError
from tools.mutation import campaign, main
from tools.mutation.changes import changes_of

SOURCE = '''"""A module."""
LIMIT: float = 2.0


class Law:
    size: int = field(default=3)

    def torque(self, q, v, *, ready=True):
        """What no change touches."""
        if not ready or q <= LIMIT < v:
            raise ValueError(f"{q + v} of 7", q - v)
        self.count += 1
        self.notify(q, v)
        self.last = -q
        return clip(min(q, v), np.zeros(3, dtype=float), strict=True) + "text"
'''
EXPECTED = """
LIMIT: float = 2.0 -> LIMIT: float = 2000.0
Law: size: int = field(default=3) -> size: int = field(default=4)
Law.torque: if not ready or q <= LIMIT < v: -> if not ready and q <= LIMIT < v:
Law.torque: if not ready or q <= LIMIT < v: -> if ready or q <= LIMIT < v:
Law.torque: if not ready or q <= LIMIT < v: -> if not ready or q < LIMIT < v:
Law.torque: if not ready or q <= LIMIT < v: -> if not ready or q <= LIMIT <= v:
Law.torque: self.count += 1 -> pass
Law.torque: self.count += 1 -> self.count += 2
Law.torque: self.notify(q, v) -> pass
Law.torque: self.notify(q, v) -> self.notify(v, q)
Law.torque: self.last = -q -> pass
Law.torque: self.last = -q -> self.last = q
"""


def test_the_changes_of_a_file(tmp_path):
    (tmp_path / "law.py").write_text(SOURCE)
    found = changes_of(tmp_path, Path("law.py"))
    texts = [str(change).removeprefix("law.py ").removeprefix(": ") for change in found]
    *usual, swapped, last = texts
    assert usual == EXPECTED.strip().splitlines()
    assert swapped.endswith('-> return clip(np.zeros(3, dtype=float), min(q, v), strict=True) + "text"')
    assert last.endswith('-> return clip(min(q, v), np.zeros(4, dtype=float), strict=True) + "text"')
    assert [change.line for change in found[:3]] == [2, 6, 10]
    assert found[0].applied(SOURCE.encode()) == SOURCE.replace("2.0", "2000.0").encode()


def test_the_choice_stays_where_the_source_does(tmp_path, monkeypatch):
    monkeypatch.setattr(campaign, "_ROOT", tmp_path)
    monkeypatch.setattr(campaign, "_PARTS", {"laws": ("*.py",)})
    (tmp_path / "law.py").write_text(SOURCE)
    before = [str(change) for change in campaign.choose(("laws",), 0, 100)]
    assert [str(change) for change in campaign.choose(("laws",), 1, 100)] != before
    (tmp_path / "law.py").write_text(SOURCE.replace("class Law", "OTHER = 5\n\n\nclass Law"))
    after = [str(change) for change in campaign.choose(("laws",), 0, 100)]
    assert [text for text in after if "OTHER" not in text] == before


def test_wrong_options_are_named(capsys):
    for arguments, told in (
        (["--part", "mitt"], r"--part: unknown part 'mitt' (did you mean 'mit'?)"),
        (["--count", "0"], "--count, --jobs: are 0 and 2, expected at least 1"),
    ):
        with pytest.raises(InputError) as refused:
            main(arguments)
        assert told in str(refused.value)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_no_change_survives_the_mirrored_tests(request, capsys):
    """Of the fixed list 12, with `--complete` all 60; and a change of a docstring, which no test can notice."""
    count = 60 if request.config.getoption("--complete") else 12
    status = main(["--count", str(count)])
    told = capsys.readouterr().out
    assert status == 0, told
    assert "0 survive" in told


@pytest.mark.slow
def test_what_no_test_notices_survives(tmp_path):
    copy = campaign.Copy(tmp_path)
    found = campaign.choose(("mit",), 0, 1)[0]
    place = campaign._ROOT / found.path
    quote = place.read_bytes().index(b'"""') + 3
    assert copy.notices(replace(found, start=quote, end=quote, new=b"Now "), None) is None
    assert copy.notices(found, "tests/test_mit.py::test_that_is_no_more").startswith("tests/test_mit.py::")
    assert (tmp_path / found.path).read_bytes() == place.read_bytes()
