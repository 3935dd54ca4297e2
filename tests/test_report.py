"""The report: every section is there, rows are valid, the page stands alone, and regressions are told."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest

import fastibl
from fastibl import measuring, reference, report
from fastibl.__main__ import main
from fastibl.measuring import Point, Row, read_rows, write_rows
from fastibl.measuring.samples import pairs
from fastibl.report import compare, inputs, plots, section
from fastibl.report.visibility import Sky

pytest.importorskip("matplotlib")

TINY = replace(
    inputs.QUICK, name="tiny", normals=40, pairs=1, exponents=(8,), alphas=((0.3, 0.3),), lobes=4, grid=6, vertices=8,
    rounds=2, batch=2000, follow=(0.4, 10), sweep=(1.0, 4), sweep_size=(160, 120), picture=8, suns=(1, 1e4),
    map_sizes=(16, 32), pixels=(80, 160),
)  # fmt: skip
NAMES = [
    "overview", "frame", "diffuse", "glossy", "anisotropic", "shadow", "self-shadow", "capture", "tracking", "bias",
    "left-out", "furnace", "stiff", "extremes", "growth", "memory", "machine",
]  # fmt: skip


def place(bright: float = 1.0) -> fastibl.CubeMap:
    faces = np.random.default_rng(0).lognormal(sigma=0.7, size=(6, 16, 16, 3)).astype(np.float32)
    faces[2, 3, 4] = 200 * bright
    return fastibl.CubeMap(faces)


@pytest.fixture(scope="module")
def made():
    import trimesh

    ball = trimesh.creation.icosphere(2, 0.03)
    mesh = fastibl.stand(fastibl.Mesh(ball.vertices, ball.faces), 0.06)
    given = report.gathered({"one": place(), "two": place(3.0)}, ("ball", mesh), None, TINY)
    return report.make_report(given, "fastibl report --tiny")


@pytest.fixture(scope="module")
def written(made, tmp_path_factory):
    out = tmp_path_factory.mktemp("report")
    report.write_report(made, out)
    return out


def test_every_section_is_there_and_says_what_it_is(made):
    assert [s.name for s in made.sections] == NAMES
    for s in made.sections:
        assert s.title and s.what and (s.missing or s.tables or s.charts), s.name
    steps = [s for s in made.sections if s.best]
    assert {"chosen", "paper"} <= set(steps[0].best) and len(steps) == 7
    for s in steps:
        assert s.charts and s.best["chosen"].time.median > 0
        print(s.name, {mark: (r.label, section.percent(r.error)) for mark, r in s.best.items()})
    assert all(s.strips for s in made.sections if s.name in ("frame", "diffuse", "glossy", "anisotropic", "shadow"))


def test_the_default_beats_the_paper_where_it_must(made):
    best = {s.name: s.best for s in made.sections if s.best}
    for name in ("diffuse", "shadow", "frame"):
        assert best[name]["chosen"].error < best[name]["paper"].error, name


def test_rows_are_of_the_one_schema(written):
    rows = read_rows(written / "report.json")
    assert len(rows) > 150 and len({compare._key(r) for r in rows}) == len(rows)
    for r in rows:
        assert r.step and r.method and r.case and r.threads >= 1 and (r.error is None or np.isfinite(r.error)), r
        assert (r.seconds is None) == (r.spread is None) == (r.yardsticks is None), r
        assert r.error is not None or r.seconds is not None, r
    head = json.loads((written / "report.json").read_text())
    assert head["places"] == ["one", "two"] and head["mesh"] == "ball" and head["machine"] == measuring.cpu()


def test_the_page_stands_alone(written, made):
    page = (written / "report.html").read_text(encoding="utf-8")
    assert not re.search(r"https?://", page) and "<script" not in page
    assert not re.search(r'(src|href)="(?!data:|#)', page)
    for name in NAMES:
        assert f'<section id="{name}">' in page
    charts = [c.name for s in made.sections for c in s.charts]
    assert len(charts) == len(set(charts)) >= 15
    for name in charts:
        assert (written / "plots" / f"{name}.png").stat().st_size > 3000
        assert b"<svg" in (written / "plots" / f"{name}.svg").read_bytes()


def row_of(error: float | None = 0.01, seconds: float | None = 1e-3, **other) -> Row:
    spread = None if seconds is None else (0.95 * seconds, 1.05 * seconds)
    yards = None if seconds is None else seconds / 0.004
    base = Row("sh9", "", "mean", "error", error, seconds, spread, yards, 1, "cpu", "a machine", "", "diffuse")
    return replace(base, **other)


@pytest.mark.parametrize(
    "new, of, worse",
    [
        (row_of(), None, None),
        (row_of(error=0.0104), None, None),  # within 5 %
        (row_of(error=0.02), "error", True),
        (row_of(error=0.005), "error", False),
        (row_of(error=np.nan), "error", True),
        (row_of(error=np.inf), "error", True),
        (row_of(seconds=1.2e-3), None, None),  # within the spread and the factor
        (row_of(seconds=2e-3), "time", True),
        (row_of(seconds=0.5e-3), "time", False),
        (row_of(seconds=2e-3, yardsticks=0.25), None, None),  # the whole machine is slower
    ],
)
def test_what_counts_as_worse(new, of, worse):
    found = compare.compare([row_of()], [new])
    changed = {c.of: c.worse for c in found.changes if c.worse is not None}
    assert changed == ({} if of is None else {of: worse})
    assert bool(found.worse) == bool(worse) and bool(found.better) == (worse is False)


def test_a_method_that_ceases_to_give_nan_is_better():
    assert compare.compare([row_of(error=np.nan)], [row_of()]).better[0].of == "error"
    assert not compare.compare([row_of(error=np.nan)], [row_of(error=np.nan)]).worse


def test_an_error_that_is_gone_and_a_step_that_is_gone_are_regressions():
    gone = compare.compare([row_of()], [row_of(error=None)])
    assert gone.regressed and gone.worse[0].of == "error" and "0.01 -> none" in compare.as_text(gone)
    assert compare.compare([row_of(error=None)], [row_of()]).better
    lost = compare.compare([row_of(), row_of(step="glossy")], [row_of()])
    assert lost.regressed and not lost.worse and "gone: all of glossy" in compare.summary(lost)
    assert not compare.compare([row_of(), row_of(case="another")], [row_of()]).regressed


def test_times_of_another_machine_do_not_count():
    new = row_of(seconds=5e-3, cpu="another")
    found = compare.compare([row_of()], [new])
    assert not found.worse and found.not_counted == 1 and "another machine" in compare.summary(found)
    assert compare.compare([row_of()], [replace(new, error=0.1)]).worse


def test_tiny_errors_and_biases_around_zero_do_not_count():
    bias = {"metric": "bias", "seconds": None, "spread": None, "yardsticks": None}
    found = compare.compare([row_of(error=1e-6, **bias)], [row_of(error=-4e-4, **bias)])
    assert not found.worse
    assert compare.compare([row_of(error=1e-6, **bias)], [row_of(error=-2e-2, **bias)]).worse[0].of == "bias"


def test_the_command_compares_and_its_exit_code_tells(written, tmp_path, capsys):
    old = written / "report.json"
    assert main(["report", "--against", str(old), "--measured", str(old)]) == 0
    assert "0 worse, 0 better" in capsys.readouterr().out
    text = json.loads(old.read_text())
    chosen = next(r for r in text["rows"] if r["step"] == "diffuse" and r["error"] and r["seconds"])
    chosen["error"] *= 3
    new = tmp_path / "new.json"
    new.write_text(json.dumps(text))
    assert main(["report", "--against", str(old), "--measured", str(new)]) == 1
    assert "worse   diffuse" in capsys.readouterr().out


def test_reports_of_other_things_do_not_compare(written, tmp_path, capsys):
    old, new = written / "report.json", tmp_path / "new.json"
    for change, word in (
        (lambda head: head.update(effort="full"), "effort"),
        (lambda head: head["contents"].update({"the mesh": "another"}), "the mesh"),
        (lambda head: head["contents"].update({"the map one": "another"}), "the map one"),
    ):
        report_of = json.loads(old.read_text())
        change(report_of)
        new.write_text(json.dumps(report_of))
        assert main(["report", "--against", str(old), "--measured", str(new)]) == 2
        assert word in capsys.readouterr().err


def test_values_that_no_measurement_has_are_named(written, tmp_path, capsys):
    wrong = tmp_path / "wrong.json"
    for name, value in (("error", "0.1"), ("spread", 3), ("spread", [1]), ("seconds", 0), ("method", [])):
        report_of = json.loads((written / "report.json").read_text())
        report_of["rows"][5][name] = value
        wrong.write_text(json.dumps(report_of))
        assert main(["report", "--against", str(wrong), "--measured", str(written / "report.json")]) == 2
        error = capsys.readouterr().err
        assert "wrong.json" in error and "row 5" in error


def test_what_was_measured_is_written_where_the_old_report_does_not_compare(made, tmp_path, monkeypatch, capsys):
    old = tmp_path / "old.json"
    write_rows(old, [row_of(case="another")], {})
    monkeypatch.setattr(report, "make_report", lambda *_: made)
    monkeypatch.setattr(report, "gathered", lambda *_: None)
    assert main(["report", "--quick", "--against", str(old), "--out", str(tmp_path / "out")]) == 2
    assert (tmp_path / "out" / "report.json").is_file() and "no row in common" in capsys.readouterr().err


def test_bad_input_is_exit_code_2(tmp_path, capsys):
    wrong = tmp_path / "wrong.json"
    for content in ("", "[]", '{"rows": [{"method": "x"}]}', '{"rows": 3}', '{"rows": []}'):
        wrong.write_text(content)
        assert main(["report", "--against", str(wrong), "--measured", str(wrong)]) == 2
        assert "wrong.json" in capsys.readouterr().err
    assert main(["report", "--measured", str(wrong)]) == 2
    assert main(["report", "--against", str(wrong), "--measured", str(wrong), "--quick"]) == 2
    assert "--quick" in capsys.readouterr().err
    assert main(["report", "--against", str(tmp_path / "missing.json")]) == 2
    assert main(["report", "--quick", "--mesh", str(tmp_path / "missing.obj")]) == 2
    assert main(["report", "--quick", "--environment", str(tmp_path / "missing.hdr")]) == 2
    assert main(["report", "--quick", "--recording", str(tmp_path / "missing")]) == 2
    assert main(["report", "--quick", "--out", str(wrong)]) == 2, "before anything is measured"
    assert capsys.readouterr().err.count("fastibl: error:") == 5
    with pytest.raises(ValueError, match="no row in common"):
        compare.compare([row_of()], [row_of(case="another")])


def test_the_comparison_is_on_the_page(made, tmp_path):
    found = compare.compare([row_of()], [row_of(error=0.5)], "old/report.json")
    part = compare.comparison_section(found)
    assert part.tables[0].marked == {0: "worse"} and "1 worse" in part.seen[0]
    small = report.Report(made.head, [s for s in made.sections if s.name == "machine"] * 2)
    report.write_report(small, tmp_path, found)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Against an earlier report" in page and "old/report.json" in page


def test_a_recording_without_truth_says_what_is_not_known(tmp_path):
    recording = fastibl.simulate(seconds=0.3, fps=10, seed=0, lamp=False, hand=False)
    bare = fastibl.Recording(recording.rig, list(recording), recording.board)
    mesh = fastibl.shapes.figurine(0.06, 0.9)
    given = inputs.Inputs({"one": place()}, mesh, "figurine", bare, bare, "bare", TINY, False)
    from fastibl.report import capture, frame, tracking

    assert "no true light" in capture.measure(given).missing
    assert (
        "can be tracked" in frame.measure(replace(given, follow=fastibl.Recording(recording.rig, list(bare)))).missing
    )
    assert frame._posed(bare)[1].angle_to(recording.truth.pose(recording.times[-1])) < np.radians(0.5)
    told = tracking.measure(given)
    assert not told.missing and "in pixels" in told.what and told.charts[0].unit == " px"


def test_capture_is_judged_without_the_printed_page():
    """The true maps lack it, so it has to be masked: else a perfect capture would be told to be 8 % off."""
    from fastibl.report.capture import _capture

    film = fastibl.simulate(place(), seconds=8.0, fps=2, size=(160, 120), path="sweep", hand=False)
    found = _capture(film, fastibl.Scene(fastibl.shapes.figurine(0.12)), "continuous", 64, float("inf"))
    print(f"median error {found.true[-1]:.4f}, predicted {found.predicted[-1]:.4f}")
    assert found.true[-1] < 0.02


def test_recordings_are_cut_to_what_is_needed():
    rig = fastibl.Rig(fastibl.Camera(16, 12, 14, 14, 8, 6))
    frames = [fastibl.Frame(0.1 * k, back=np.zeros((12, 16, 3), np.uint8)) for k in range(40)]
    long = fastibl.Recording(rig, frames)
    assert inputs.beginning(long, inputs.QUICK).times == long.times[:8]
    spread = inputs.thinned(long, inputs.QUICK).times
    assert len(spread) == 16 and (spread[0], spread[-1]) == (long.times[0], long.times[-1])
    assert len(inputs.thinned(fastibl.Recording(rig, frames[:3]), inputs.QUICK)) == 3


def test_a_sky_without_a_bright_texel():
    """An overcast one: nothing is to be cut finer."""
    from fastibl.report import self_shadow, shadow

    sky = fastibl.CubeMap(np.full((6, 32, 32, 3), 0.5, np.float32))
    ball = fastibl.stand(fastibl.shapes.figurine(0.06), 0.06)
    given = report.gathered({"overcast": sky}, ("figurine", ball), None, TINY)
    assert shadow.measure(given).rows and self_shadow.measure(given).rows


def test_visibility_against_the_reference():
    """Rays only towards the bounding sphere, and bright texels cut finer, against every texel of the reference."""
    mesh = fastibl.shapes.figurine(0.12, 0.9)
    soft = fastibl.CubeMap(np.random.default_rng(1).uniform(0.5, 1.5, (6, 32, 32, 3)).astype(np.float32))
    given = inputs.Inputs({"soft": soft}, mesh, "figurine", None, None, "", TINY, False)
    points = np.array([[0.05, 0.02], [0.15, -0.1], [0.0, 0.0], [0.4, 0.4]])
    ours, theirs = Sky(given).plane_ratio(mesh, points), reference.shadow_ratio(soft, mesh, points)
    print("largest difference of the ratio", np.abs(ours - theirs).max())
    np.testing.assert_allclose(ours, theirs, atol=5e-3)


def test_maps_side_by_side_give_each_its_own_truth():
    a, b = place(), place(5.0)
    both = np.concatenate([a.faces, b.faces], axis=-1)
    n, v = pairs(1)
    for of in (lambda m: reference.irradiance(m, n), lambda m: reference.glossy(m, n, v, 20.0)):
        np.testing.assert_allclose(of(both), np.concatenate([of(a), of(b)], axis=-1), rtol=1e-12)


def test_labels_keep_apart_and_the_same_rows_draw_the_same_bytes():
    """Labels of 14 points, some close together: none over another."""
    from matplotlib.text import Text

    points = [Point("a", f"size={k}", 1e-6 * 1.15**k, 0.2 / 1.3**k) for k in range(12)]
    points += [Point("b", "", 2e-6, 0.05), Point("c", "", 2.1e-6, 0.048)]
    chart = plots.Frontier("x", "x", "time", "error", points, paper=["b"], chosen=["c"])
    figure = plots.draw(chart)
    figure.canvas.draw()
    texts = [Text.get_window_extent(t) for t in figure.axes[0].texts]  # without the leaders
    assert len(texts) == 14
    overlaps = sum(s.overlaps(t) for k, s in enumerate(texts) for t in texts[:k])
    print("overlapping labels", overlaps)
    assert overlaps == 0
    assert plots.svg(plots.draw(chart)) == plots.svg(plots.draw(chart))


def test_numbers_as_people_read_them():
    assert [section.percent(v) for v in (0.0027, 0.17, 1.0, 3.4, float("nan"), None)] == [
        "0.27 %", "17 %", "100 %", "340 %", "–", "–",
    ]  # fmt: skip
    assert [section.signed(v) for v in (0.0, 0.013, -0.5, 1.65)] == ["0 %", "+1.3 %", "-50 %", "+165 %"]
    assert [measuring.seconds_text(s) for s in (2.0, 3.2e-3, 4e-6, 5e-9)] == ["2 s", "3.2 ms", "4 µs", "5 ns"]


def test_an_exact_paper_and_lines_that_are_no_numbers():
    """As in a black place, where every method is exact, and where a method gave NaN."""
    from fastibl.report import plots, steps

    assert steps._smaller(0.0) and "less" in steps._smaller(3.0)

    def said(chosen, paper):
        time = measuring.timing([1.0], [1.0])
        results = [
            steps.Result("a", "", {"x": e}, {}, time, m) for e, m in ((chosen, steps.CHOSEN), (paper, steps.PAPER))
        ]
        return steps.sentences(results)[1]

    assert "has about the same error" in said(0.0, 0.0) and "times the error" in said(0.1, 0.0)
    pytest.importorskip("matplotlib")
    points = [plots.Point("a", "", 1.0, np.nan), plots.Point("b", "", 1.0, np.inf), plots.Point("c", "", 2.0, 0.1)]
    for some in (points, points[:2]):
        assert plots.draw_frontier(plots.Frontier("x", "a title", "s", "error", some)) is not None
