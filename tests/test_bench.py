"""The schema of measurements, the yardstick, and what the goals' table says and returns."""

import importlib
import json
import math
from functools import partial

import numpy as np
import pytest

import fastibl
from bench import brute, goals, measure, paper
from bench.goals import Goal
from fastibl.measuring import samples


def numbered(count):
    times = measure.timing(np.arange(1, count + 1) / 1000, np.ones(count) / 1000)
    return [measure.row("sh9", f"map {k}", "mean error", 0.123456, times, setting="level=2") for k in range(count)]


def test_rows_round_trip_sorted_and_stable(tmp_path, monkeypatch):
    monkeypatch.setattr("fastibl.measuring.rows.yardstick_seconds", lambda: 0.004)
    rows = [*numbered(3), measure.row("none", "a case without time", "RMS", 0.5), measure.row("mip", "only time")]
    path = measure.write_rows("example", rows[::-1], tmp_path)
    first = path.read_bytes()
    assert json.loads(first)["command"] == "./dev bench example"
    read = measure.read_rows("example", tmp_path)
    assert sorted(read, key=repr) == sorted(rows, key=repr)
    assert read[0].case == "a case without time" and read[0].seconds is None and read[0].spread is None
    assert measure.write_rows("example", rows, tmp_path).read_bytes() == first
    timed = next(r for r in read if r.case == "map 0")
    assert (timed.error, timed.seconds, timed.yardsticks) == (0.1235, 0.002, 0.5)
    assert timed.spread == (0.0012, 0.0028) and "cores" in timed.cpu


def test_rows_of_another_schema_are_refused(tmp_path):
    (tmp_path / "old.json").write_text('{"rows": [{"method": "sh9"}]}')
    with pytest.raises(ValueError, match="yardsticks"):
        measure.read_rows("old", tmp_path)


@pytest.mark.parametrize("path", sorted(measure.RESULTS.glob("*.json")), ids=lambda p: p.stem)
def test_stored_results_have_the_schema(path):
    rows = measure.read_rows(path.stem)
    assert rows and path.stat().st_size < 400_000
    assert all(math.isfinite(r.error) for r in rows if r.error is not None)
    assert all((r.seconds is None) == (r.yardsticks is None) == (r.spread is None) for r in rows)


def test_yardstick_runs():
    time = measure.yardstick(repetitions=3)
    assert 0 < time.low <= time.median <= time.high < 1 and time.count == 3


def test_the_yardstick_is_that_of_now(monkeypatch):
    """Shared machines run at half of their speed for minutes."""
    clock = importlib.import_module("fastibl.measuring.timing")  # the package has a function of that name
    now, taken = [100.0], iter((0.004, 0.009))
    monkeypatch.setattr(clock.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(clock, "yardstick", lambda count: measure.timing([1.0], [next(taken)]))
    monkeypatch.setattr(clock, "_measured", (-math.inf, 0.0))
    assert clock.yardstick_seconds() == clock.yardstick_seconds() == 0.004
    now[0] += 21
    assert clock.yardstick_seconds() == 0.009


def test_measure_varies_its_inputs():
    given = []
    time = measure.measure(given.append, [1, 2], repetitions=5, warm=1)
    assert given == [1, 1, 2, 1, 2, 1] and time.count == 5
    with pytest.raises(ValueError, match="input"):
        measure.measure(print, [])
    with pytest.raises(ValueError, match="repetition"):
        measure.timing([], [])


def fake(*lines):
    def rows():
        yield from lines

    return goals.Row("fake", rows)


MET = Goal("nearest-face", "47 %", "47 %", True, ("by map: studio 120 %",))
MISSED = Goal("sh9", "5.0 %", "2.8 %", False)
SKIPPED = goals.skipped("GL", "built without GL")


def test_table_has_columns_and_notes(capsys):
    assert goals.report({"paper": [fake(MET, SKIPPED)]}, "a machine") == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "goals: paper (a machine)"
    assert lines[1].split() == ["what", "measured", "goal", "pass"]
    assert lines[3].startswith("nearest-face  47 %") and lines[3].endswith("yes")
    assert lines[4].strip() == "by map: studio 120 %"
    assert "skipped" in lines[5] and "built without GL" in lines[5] and lines[5].endswith("-")
    assert lines[-1] == "1 met, 0 missed, 1 skipped"


def test_a_missed_goal_and_a_broken_row_fail(capsys):
    assert goals.report({"paper": [fake(MET, MISSED)]}, "a machine") == 1
    assert "no" in capsys.readouterr().out.splitlines()[5].split()

    def broken():
        raise RuntimeError("no light")
        yield

    assert goals.report({"paper": [goals.Row("broken", broken), fake(MET)]}, "a machine") == 1
    out = capsys.readouterr().out
    assert "RuntimeError: no light" in out and "1 met, 1 missed, 0 skipped" in out


def test_goals_of_numpy_truths_count_as_others_do(capsys):
    met, missed = (Goal("time", "1", "2", truth) for truth in (np.float64(1) <= 2, np.float64(3) <= 2))
    assert goals.report({"light": [fake(met)]}, "a machine") == 0
    assert "1 met, 0 missed" in capsys.readouterr().out
    assert goals.report({"light": [fake(met, missed)]}, "a machine") == 1
    assert "1 met, 1 missed, 0 skipped" in capsys.readouterr().out


def test_only_selects_rows_by_word(capsys):
    assert goals.main(["paper", "--only", "FURNACE"]) == 0
    out = capsys.readouterr().out
    assert "white furnace, sh9" in out and "six-face" in out and "3 met, 0 missed" in out
    with pytest.raises(SystemExit) as caught:
        goals.main(["paper", "--only", "nothing of the kind"])
    assert caught.value.code == 2 and "white furnace" in capsys.readouterr().err


def test_face_weights_by_quadrature():
    """Symmetry and sums: a face seen head on, and pi over all."""
    weights = paper.face_weights(np.array([(0.0, 0.0, 1.0), (0.6, 0.0, 0.8), (-0.36, 0.48, 0.8)]))
    np.testing.assert_allclose(weights.sum(axis=1), np.pi, rtol=1e-12)
    np.testing.assert_allclose(weights[0, :4], weights[0, 0], rtol=1e-12)
    assert weights[0, 5] == 0 and weights[0].argmax() == 4


def test_pairs_have_the_angles_that_they_say():
    n, v = samples.pairs(4)
    degrees = np.degrees(np.arccos(np.clip((n * v).sum(axis=1), -1, 1)))
    np.testing.assert_allclose(degrees, np.repeat(samples.ANGLES, 4), atol=1e-5)
    assert fastibl.methods("glossy")


def test_frontier_and_plot(tmp_path):
    from bench.plot import Point, draw, frontier, points

    def of(method, setting, error, seconds):
        return measure.Row(method, setting, "mean", "error; seconds", error, seconds, None, None, 1, "cpu", "", "")

    rows = [of("a", "exponent=2 taps=1", 0.1, 2.0), of("a", "exponent=8 taps=1", 0.3, 4.0), of("b", "", 0.1, 1.0)]
    ((metric, found),) = points([*rows, of("c", "", None, 1.0)]).items()
    assert metric == "error; seconds" and len(found) == 2
    a, b = sorted(found, key=lambda p: p.method)
    assert a.setting == "taps=1" and a.error == pytest.approx(0.2) and a.label == "a taps=1"
    # b is ahead of a in both; what is slower and more exact is on the frontier too, what is slower and worse is not.
    exact, worse = Point("x", "", 9.0, 0.01), Point("w", "", 9.5, 0.5)
    assert frontier([worse, exact, a, b]) == [b, exact]
    draw(metric, [*found, exact, worse], tmp_path / "p.svg")
    first = (tmp_path / "p.svg").read_bytes()
    draw(metric, [*found, exact, worse], tmp_path / "p.svg")
    assert first == (tmp_path / "p.svg").read_bytes() and b"<svg" in first


def test_what_is_no_number_is_not_met():
    assert goals.Goal("error", "nan %", "<= 1 %", True).verdict == "no"
    assert goals.Goal("nanometres", "1 nanometre", "<= 1", True).verdict == "yes"
    assert goals.largest([1.0, 3.0, 2.0]) == 3 and np.isnan(goals.largest([1.0, np.nan, 2.0]))
    with pytest.raises(ValueError, match="zero-size"):
        goals.largest([])
    with pytest.raises(ValueError, match="1 of 6 values differ by what is no finite number"):
        brute.errors([[0, 0, 0], [0, np.nan, 0]], np.ones((2, 3)), 1.0)


def test_a_row_that_ends_the_program_hides_no_other():
    def ends():
        yield goals.Goal("before", "1", "1", True)
        raise SystemExit(2)

    def interrupted():
        raise KeyboardInterrupt
        yield

    def fine():
        yield goals.Goal("after", "1", "1", True)

    rows = [goals.Row(f.__name__, f) for f in (ends, fine, interrupted, fine)]
    assert [(g.what, g.verdict) for g in goals.measured(rows)] == [
        ("before", "yes"), ("ends", "no"), ("after", "yes"), ("interrupted", "no"),
    ]  # fmt: skip


def test_what_is_kept_is_that_of_its_code(tmp_path, monkeypatch):
    monkeypatch.setattr(brute, "CACHE", tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    code = "import numpy as np\ndef make(times=1):\n    return times * np.full(1, {})\n"
    (tmp_path / "made_here.py").write_text(code.format(1))
    made = importlib.import_module("made_here")
    assert brute.stored(["a"], made.make) == 1
    (tmp_path / "made_here.py").write_text(code.format(23))
    importlib.reload(made)
    assert brute.stored(["a"], made.make) == 23 and brute.stored(["b"], partial(made.make, 2)) == 46
