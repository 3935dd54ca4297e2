"""Every expectation of `fastibl extremes` holds; the command says so, and fails where one does not."""

import json
import re
from pathlib import Path

import pytest

from fastibl import extremes
from fastibl.__main__ import main
from fastibl.extremes.case import Case, Outcome, equal, is_light, is_ratio, refused, run_case
from fastibl.gl_device import gl_device

DOCS = Path(__file__).parents[1] / "docs" / "extremes.md"
MISSING = gl_device()[1]
CASES = extremes.all_cases()
STEPS = list(dict.fromkeys(case.step for case in CASES))


@pytest.mark.parametrize("step", STEPS)
def test_expectations_hold(step):
    rows = [extremes.run_case(c) for c in CASES if c.step == step and (c.backend == "cpu" or not MISSING)]
    print(extremes.table(rows))
    broken = [row for row in rows if not row.held]
    assert not broken, extremes.table(broken)


def test_there_are_many_and_each_is_another():
    titles = [case.title for case in CASES]
    repeated = {t for t in titles if titles.count(t) > 1}
    print(f"{len(CASES)} cases, {sum(c.backend == 'gl' for c in CASES)} of them on GL")
    assert len(CASES) >= 300 and not repeated
    assert all(case.expectation for case in CASES)


def test_the_docs_list_every_step_and_count():
    """The table of docs/extremes.md is what `fastibl extremes` has."""
    text = DOCS.read_text()
    for step in STEPS:
        cpu = sum(c.step == step and c.backend == "cpu" for c in CASES)
        gl = sum(c.step == step and c.backend == "gl" for c in CASES)
        assert re.search(rf"^\| {re.escape(step)} \| {cpu} \| {gl or '–'} \|", text, re.M), (step, cpu, gl)


def test_a_broken_expectation_is_said_and_fails():
    raising = Case("maps", "that raises", "nothing", lambda: 1 / 0)
    assert not run_case(raising).held and "ZeroDivisionError" in run_case(raising).outcome
    assert not equal([1.0, 2], [1, 2.1], 0.01).held and equal([1.0, 2], [1, 2]).held
    assert not is_light([1.0, float("nan")]).held and not is_light([-1.0]).held and not is_light([2.0], 1).held
    assert not is_ratio([0.0, 1.1]).held
    assert not refused(lambda: None).held
    with pytest.raises(RuntimeError):  # another kind is no refusal
        refused(lambda: (_ for _ in ()).throw(RuntimeError("x")))


def test_the_command(tmp_path, capsys, monkeypatch):
    path = tmp_path / "rows.json"
    assert main(["extremes", "--only", "solid angles", "--backend", "cpu", "--json", str(path)]) == 0
    out = capsys.readouterr().out
    rows = json.loads(path.read_text())["cases"]
    assert len(rows) == 8 and all(row["held"] for row in rows) and "8 of 8 expectations hold" in out
    assert main(["extremes", "--only", "no such case"]) == 2
    assert "no case has" in capsys.readouterr().err
    broken = [Case("maps", "broken", "to hold", lambda: Outcome(False, "it does not"))]
    monkeypatch.setattr(extremes, "all_cases", lambda only="", backend="all": broken)
    assert main(["extremes", "--backend", "cpu"]) == 1
    assert "BROKEN" in capsys.readouterr().out


def test_rows_go_where_there_is_a_folder(tmp_path, capsys):
    assert main(["extremes", "--only", "no such", "--json", str(tmp_path / "no" / "x.json")]) == 2
    assert "no folder" in capsys.readouterr().err
    assert main(["extremes", "--backend", "cpu", "--only", "a lamp between", "--json", str(tmp_path / "x.json")]) == 0
    assert json.loads((tmp_path / "x.json").read_text(), parse_constant=pytest.fail)["cases"]
