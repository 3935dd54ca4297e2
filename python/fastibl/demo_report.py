"""The demo's report: one self-contained page, videos beside it."""

from __future__ import annotations

import html
from pathlib import Path

import numpy as np

from ._fastibl import __version__
from .demo import HEIGHT, DemoResult, Run
from .pages import STYLE, figure, plot, table
from .recording import truth_of
from .whole_file import write_whole


def _time_plots(result: DemoResult) -> str:
    from matplotlib.figure import Figure

    truth, times = truth_of(result.recording), result.times
    drawn = Figure(figsize=(10, 6.2))
    axes = drawn.subplots(3, 1, sharex=True)
    colours = {"default": "#0b6e99", "paper": "#b4552d"}
    for name, run in result.runs.items():
        label = "default" if name == "default" else "the paper's"
        axes[0].plot(times, 100 * np.array(run.irradiance_error), color=colours[name], label=f"{label}: true")
        axes[0].plot(
            times, 100 * np.array(run.predicted_error), color=colours[name], ls=":", label=f"{label}: predicted"
        )
        axes[1].plot(times, 100 * np.array(run.coverage), color=colours[name], label=label)
        axes[2].semilogy(times, np.maximum(run.pose_degrees, 1e-4), color=colours[name], label=label)
    axes[0].set_ylabel("irradiance error, %")
    axes[0].set_ylim(0, 100)
    axes[1].set_ylabel("sphere seen, %")
    axes[1].set_ylim(0, 100)
    axes[2].set_ylabel("pose error, degrees")
    axes[2].set_xlabel("time, s")
    for axis in axes:
        if truth.hand is not None:
            axis.axvspan(*truth.hand, color="#000", alpha=0.1, lw=0)
        if truth.lamp_time is not None:
            axis.axvline(truth.lamp_time, color="#d4a017", lw=2)
        axis.spines[["top", "right"]].set_visible(False)
    top = axes[0].get_ylim()[1]
    if truth.hand is not None:
        axes[0].text(np.mean(truth.hand), 0.9 * top, "hand", ha="center", fontsize=9)
    if truth.lamp_time is not None:
        axes[0].text(truth.lamp_time, 0.9 * top, " lamp on", fontsize=9)
    axes[0].legend(ncol=2, fontsize=8, frameon=False, loc="upper right")
    return plot(drawn)


def _percent(value: float) -> str:
    return "–" if not np.isfinite(value) else f"{100 * value:.3g} %"


def _error_rows(result: DemoResult) -> list[tuple[str, str, str, str]]:
    default, paper = result.runs["default"], result.runs["paper"]

    def row(name: str, value, note: str) -> tuple[str, str, str, str]:
        return name, value(default), value(paper), note

    def pose(run: Run) -> str:
        return f"{np.nanmedian(run.pose_degrees):.3f}° · {np.nanmedian(run.pose_millimetres):.2f} mm"

    rows = [
        row("pose", pose, "median over the frames; the paper's uses one tag, the default the whole board"),
        row("sphere seen", lambda r: _percent(r.coverage[-1]), "share of all directions, at the end"),
        row(
            "captured map",
            lambda r: f"{_percent(r.map_error)} of {100 * r.map_share:.0f} % of the seen texels",
            "median over the texels seen since the lamp went on; what a hand covered last or every exposure clipped does not count",
        ),
        row(
            "irradiance of the captured map",
            lambda r: _percent(r.irradiance_error[-1]),
            "median over normals, at the end",
        ),
        row("… as predicted", lambda r: _percent(r.predicted_error[-1]), "told by fastibl without knowing the truth"),
        row(
            "irradiance method alone",
            lambda r: _percent(r.method_error["irradiance"]),
            "given the true map",
        ),
        row(
            "shadow method alone",
            lambda r: f"{r.method_error['shadow']:.3f}",
            "given the true map, RMS of the ratio",
        ),
    ]
    for still in result.stills:
        if still.true is None:
            continue
        title = still.title
        rows.append(
            row(f"shadow, {title}", lambda r, t=title: f"{r.shadow_error[t]:.3f}", "RMS of the ratio on the plane")
        )
        rows.append(
            row(
                f"picture, {title}",
                lambda r, t=title: _percent(r.image_error[t]),
                "RMS in linear light where object or shadow is",
            )
        )
    return rows


def write_report(result: DemoResult, out: Path) -> Path:
    """Writes report.html to `out`, which holds the two videos already; returns its path."""
    default, paper = result.runs["default"], result.runs["paper"]
    passes = "track capture mips irradiance shadow self_shadow bounce plane shade composite total".split()
    times = [
        (
            p,
            f"{default.milliseconds(p):.2f}",
            f"{paper.milliseconds(p):.2f}",
            f"{sum(p in t for t in paper.timings)} of {len(paper.timings)}",
        )
        for p in passes
    ]
    stills = []
    for still in result.stills:
        figures = [
            figure(still.pictures["default"], "fastibl, default methods"),
            figure(still.pictures["paper"], "the paper's methods"),
        ]
        if still.true is not None:
            figures.append(figure(still.true.image, "truth, by brute force"))
        at = f"{result.times[still.index]:.1f} s"
        stills.append(
            f'<h3>{html.escape(still.title.capitalize())} ({at})</h3><div class="row">{"".join(figures)}</div>'
        )
    maps = "".join(figure(picture, name) for name, picture in result.maps.items())
    truth = truth_of(result.recording)
    events = []
    if truth.hand is not None:
        events.append(f"a hand covers the front camera from {truth.hand[0]:.1f} to {truth.hand[1]:.1f} s")
    if truth.lamp_time is not None:
        events.append(f"a lamp is switched on at {truth.lamp_time:.1f} s")
    fps = 1000 / max(default.milliseconds("total"), 1e-6)
    page = f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>fastibl demo report</title><style>{STYLE}</style></head><body>
<h1>A virtual figurine, lit by the room it stands in</h1>
<p class="lead">fastibl measured the light of a room with two ordinary cameras and a printed board, lit a virtual object
with it, laid it over the camera's picture, and says here how wrong each step was.</p>
<div class="numbers">
<div><b>{np.nanmedian(default.pose_degrees):.3f}°</b><span>pose error, median</span></div>
<div><b>{_percent(default.map_error)}</b><span>error of the captured light, median over directions</span></div>
<div><b>{_percent(default.irradiance_error[-1])}</b><span>error of what lights a surface; predicted {_percent(default.predicted_error[-1])}</span></div>
<div><b>{fps:.0f} fps</b><span>whole frame, {result.recording.rig.back.width} × {result.recording.rig.back.height}, on the CPU</span></div>
</div>
<div class="row"><figure><video src="four-panel.webm" controls autoplay muted loop></video>
<figcaption>Upper left: what the back camera sees. Upper right: the composite. Below: the light as captured so far
(unseen parts dimmed) and as it truly is. Both maps show all directions around the object, up at the top.</figcaption></figure></div>
<h2>What happens</h2>
<p>A hand carries the rig around a board on a table ({result.times[-1]:.0f} s). The back camera sees the board, which gives the
pose. Both cameras see the room; every picture paints the directions that it sees into an environment map, the front
camera with three exposures 4 stops apart, so that lamps and windows keep their true brightness. {html.escape("; ".join(events).capitalize())}.
The object ({100 * HEIGHT:.0f} cm high, {len(result.scene.mesh.triangles)} triangles; the paper takes {len(result.scene.spheres)} spheres for its shadow) is lit by that map alone.
The room is simulated, so the truth is known: pose, light, and the picture that a perfect system would have made
(6144 directions of the true map, visibility by rays).</p>
<h2>Pictures</h2>{"".join(stills)}
<h2>The light</h2><div class="row">{maps}</div>
<h2>Error of each step</h2>
{table(["step", "default", "the paper's", "how it is measured"], _error_rows(result), note_last=True)}
<p>The paper's own methods stay available by name, so that “better” is always measured against them. Its capture takes one
picture of one exposure every five seconds; where that clips, the light is lost.</p>
<h2>Over time</h2>{_time_plots(result)}
<p>Solid: true error of the irradiance, median over normals. Dotted: the error that fastibl predicted from what it had seen.
Nobody said how far the walls are: fastibl found them {default.distance:.1f} m away, from how pictures taken from several
places differ. What is nearer or farther is displaced.</p>
<h2>Time of each pass</h2>
{table(["pass, median ms where it ran", "default", "the paper's", "the paper's ran in frames"], times)}
<p>{html.escape(result.machine)}; fastibl {html.escape(__version__)}.</p>
<h2>The plan</h2><p>What a frame needs, by which method, and what was left out and why:</p>
<div class="row"><pre>{html.escape(default.plan)}</pre><pre>{html.escape(paper.plan)}</pre></div>
<h2>Do it yourself</h2>
<pre>fastibl simulate my-recording --environment room.hdr
fastibl render my-recording --object spot.obj --height 0.12 --out out.webm</pre>
</body></html>"""
    path = out / "report.html"
    write_whole(path, page)
    return path
