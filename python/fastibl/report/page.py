"""The report as one page that needs no other files."""

from __future__ import annotations

import html
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from .. import pages
from ..measuring import frontier, seconds_text
from ..whole_file import write_whole
from .plots import Dumbbells, Frontier, Lines, write
from .section import Section, Strip, Table

if TYPE_CHECKING:
    from . import Report

STYLE = (
    pages.STYLE
    + """
:root { --wash: #f6f8fa; --gold: #fff8e6; --blue: #eef6fa; }
html { scroll-behavior: smooth; }
body { max-width: none; margin: 0; padding: 0; background: #fff; }
.page { display: grid; grid-template-columns: 230px minmax(0, 1fr); gap: 0 3rem; max-width: 1420px; margin: 0 auto; padding: 0 1.6rem; }
nav { position: sticky; top: 0; align-self: start; height: 100vh; overflow-y: auto; padding: 2.6rem 0 2rem; font-size: .93rem; }
nav b { display: block; font-size: 1.05rem; margin-bottom: .8rem; } nav ol { list-style: none; margin: 0; padding: 0; }
nav a { display: block; color: var(--soft); text-decoration: none; padding: .24rem .7rem; border-left: 2px solid var(--line); }
nav a:hover { color: var(--accent); border-color: var(--accent); }
main { min-width: 0; padding: 2.4rem 0 5rem; }
h1 { font-size: 2.35rem; line-height: 1.15; letter-spacing: -.02em; margin-bottom: .5rem; }
h2 { font-size: 1.6rem; letter-spacing: -.01em; margin: 0 0 .5rem; } h3 { font-size: 1.05rem; margin: 1.6rem 0 .3rem; }
p.lead { max-width: 62rem; } .what { color: var(--soft); max-width: 62rem; margin: .2rem 0 .8rem; }
section { border-top: 1px solid var(--line); margin-top: 2.8rem; padding-top: 2.2rem; scroll-margin-top: .5rem; }
.seen { background: var(--blue); border-left: 3px solid var(--accent); padding: .65rem 1rem; border-radius: 0 6px 6px 0; max-width: 62rem; margin: .8rem 0 1rem; }
.seen p { margin: .15rem 0; } .missing { background: var(--wash); padding: .7rem 1rem; border-radius: 6px; color: var(--soft); }
.side { display: grid; grid-template-columns: minmax(0, 1.06fr) minmax(0, 1fr); gap: 1.6rem; align-items: start; }
.charts { display: grid; grid-template-columns: repeat(auto-fit, minmax(320px, 1fr)); gap: 1rem; } .over { max-width: 720px; } .charts .wide { grid-column: 1 / -1; } .charts.single { grid-template-columns: minmax(0, 640px); }
img.plot { border-radius: 0; }
.scroll { overflow-x: auto; } table { font-size: .9rem; } th { vertical-align: bottom; line-height: 1.25; }
td:first-child { min-width: 8.5rem; } td { white-space: nowrap; } td.text { white-space: normal; min-width: 11rem; text-align: left; } th.text { text-align: left; }
table.compact { font-size: .8rem; margin-top: 0; } table.compact th, table.compact td { padding: .17rem .38rem; }
table.compact td:first-child { white-space: normal; min-width: 9rem; } table.compact th { font-size: .78rem; }
tr.chosen td { background: var(--blue); font-weight: 600; } tr.paper td { background: #fdf3ee; }
tr.chosen td:first-child::before { content: "★ "; color: var(--accent); } tr.paper td:first-child::before { content: "◇ "; color: var(--warm); }
tr.worse td { background: #fdecea; } tr.better td { background: #eaf6ee; }
.note { color: var(--soft); font-size: .86rem; margin: .2rem 0 .6rem; max-width: 62rem; }
.strip { display: grid; grid-template-columns: repeat(auto-fit, minmax(150px, 1fr)); gap: .7rem; margin: .5rem 0; max-width: 1150px; }
.strip.large { grid-template-columns: repeat(auto-fit, minmax(230px, 1fr)); }
.strip img { background: none; } figcaption { margin-top: .25rem; line-height: 1.3; }
pre { line-height: 1.4; font-size: .8rem; background: var(--wash); }
.meta { color: var(--soft); font-size: .9rem; margin: .4rem 0 1.2rem; }
details summary { cursor: pointer; color: var(--accent); margin: .6rem 0; }
footer { border-top: 1px solid var(--line); margin-top: 3rem; padding-top: 1rem; color: var(--soft); font-size: .88rem; }
@media (max-width: 1080px) { .page { grid-template-columns: minmax(0, 1fr); } nav { position: static; height: auto; padding: 1.2rem 0 0; }
  nav ol { display: flex; flex-wrap: wrap; gap: 0 .3rem; } main { padding-top: 1rem; } .side { grid-template-columns: minmax(0, 1fr); } }
@media (max-width: 560px) { .page { padding: 0 .9rem; } h1 { font-size: 1.75rem; } table { font-size: .82rem; } th, td { padding: .3rem .4rem; }
  .strip, .strip.large { grid-template-columns: repeat(2, minmax(0, 1fr)); } .strip.hero { grid-template-columns: repeat(3, minmax(0, 1fr)); } .charts { grid-template-columns: minmax(0, 1fr); } }
@media print { .scroll, pre { overflow: visible; } th, td { white-space: normal; padding: .1rem .3rem; } table { font-size: .7rem; }
nav { display: none; } .page { display: block; } section { break-inside: avoid-page; } }
"""
)

_BESIDE = 7  # most columns of a table that stands beside a plot
_LONG = 26  # characters from which on a column counts as prose


def _table(t: Table) -> str:
    if not t.rows:
        return ""
    prose = [any(len(str(r[k])) > _LONG for r in t.rows) and k > 0 for k in range(len(t.head))]

    def cells(values: Sequence[str], tag: str) -> str:
        return "".join(
            f"<{tag}{' class=text' if prose[k] else ''}>{html.escape(str(v))}</{tag}>" for k, v in enumerate(values)
        )

    body = "".join(
        f"<tr{f' class={t.marked[k]}' if k in t.marked else ''}>{cells(r, 'td')}</tr>" for k, r in enumerate(t.rows)
    )
    title = f"<h3>{html.escape(t.title)}</h3>" if t.title else ""
    note = f'<p class="note">{html.escape(t.note)}</p>' if t.note else ""
    name = html.escape(t.title or f"Table of {', '.join(t.head[:3])}")
    return (
        f'{title}<div class="scroll" tabindex="0" role="region" aria-label="{name}"><table{" class=compact" if t.compact else ""}><thead><tr>{cells(t.head, "th")}</tr></thead><tbody>{body}</tbody></table>'
        f"</div>{note}"
    )


def _strip(s: Strip) -> str:
    widest = max(p.shape[1] / p.shape[0] for _, p in s.pictures)
    figures = "".join(pages.figure(picture, caption) for caption, picture in s.pictures)
    large = " large" if widest > 1.15 and len(s.pictures) < 5 else ""
    note = f'<p class="note">{html.escape(s.note)}</p>' if s.note else ""
    return f'<h3>{html.escape(s.title)}</h3><div class="strip{large}">{figures}</div>{note}'


def _image(name: str, title: str, svg: bytes, wide: bool = False) -> str:
    text = html.escape(title)
    return f'<img class="plot{" wide" if wide else ""}" id="plot-{name}" alt="{text}" src="{pages.svg_data(svg)}">'


def _in_words(c: Frontier) -> str:
    """A plot in words, for people who cannot see it."""
    ahead = "; ".join(f"{p.label}: {p.error:.3g} in {seconds_text(p.seconds)}" for p in frontier(c.points))
    return f"{c.title}: {c.error} against {c.time}. On the frontier: {ahead}."


def section_html(s: Section, drawn: dict[str, bytes]) -> str:
    """drawn: SVG by name of a chart."""
    what = f'<p class="what">{html.escape(" ".join(s.what.split()))}</p>' if s.what else ""
    out = [f'<section id="{s.name}"><h2>{html.escape(s.title)}</h2>{what}']
    if s.missing:
        return "".join([*out, f'<p class="missing">{html.escape(s.missing)}</p></section>'])
    if s.seen:
        out.append('<div class="seen">' + "".join(f"<p>{html.escape(line)}</p>" for line in s.seen) + "</div>")
    tables = list(s.tables)
    fronts = [c for c in s.charts if isinstance(c, Frontier)]
    lines = [c for c in s.charts if isinstance(c, Lines)]
    for c in fronts:
        table = tables.pop(0) if tables else Table((), ())
        plot, beside = _image(c.name, _in_words(c), drawn[c.name]), _table(table)
        if len(table.head) > _BESIDE:
            out.append(f'<div class="over">{plot}</div>{beside}')
        else:
            out.append(f'<div class="side"><div>{plot}</div><div>{beside}</div></div>')
    out += [_image(c.name, c.title, drawn[c.name]) for c in s.charts if isinstance(c, Dumbbells)]
    if lines:
        out.append(
            f'<div class="charts{" single" * (len(lines) == 1)}">{"".join(_image(c.name, c.title, drawn[c.name], c.wide) for c in lines)}</div>'
        )
    out += [_strip(strip) for strip in s.strips]
    short, long = [t for t in tables if len(t.rows) <= 16], [t for t in tables if len(t.rows) > 16]
    out += [_table(t) for t in short]
    for t in long:
        out.append(f"<details><summary>All {len(t.rows)} rows</summary>{_table(t)}</details>")
    for title, text in s.text:
        out.append(f"<h3>{html.escape(title)}</h3><pre>{html.escape(text)}</pre>")
    return "".join(out) + "</section>"


def write_page(report: Report, out: Path) -> Path:
    """Writes report.html, and the plots beside it as SVG and PNG; returns the page's path."""
    drawn = {chart.name: write(chart, out / "plots") for s in report.sections for chart in s.charts}
    links = "".join(f'<li><a href="#{s.name}">{html.escape(s.title)}</a></li>' for s in report.sections)
    hero = next((strip for s in report.sections if s.name == "frame" for strip in s.strips), None)
    head = report.head
    meta = " · ".join(str(v) for v in (head["machine"], f"fastibl {head['version']} {head['commit']}".strip(),
                                       head["date"], f"{head['effort']} report, {head['seconds']:.0f} s"))  # fmt: skip
    # The truth, the default's picture and the paper's, without the differences.
    shown = "".join(pages.figure(p, c) for c, p in hero.pictures if "difference" not in c) if hero else ""
    body = "".join(section_html(s, drawn) for s in report.sections)
    places = ", ".join(html.escape(p) for p in head["places"])
    page = f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>fastibl: error against time</title><style>{STYLE}</style></head><body><div class="page">
<nav><b>fastibl, measured</b><ol>{links}</ol></nav><main>
<h1>How wrong, and how fast?</h1>
<p class="lead">fastibl lights a virtual object by the light of the place it stands in, live, in a camera picture. Each step of
that can be done by several methods. This page measures all of them on this machine: how far each is from the truth, worked out
by brute force, and how long it takes; against the methods of the paper that it started from (Fast Image-Based Lighting, 2014).</p>
<p class="meta">{html.escape(meta)}<br>Places: {places}. Object: {html.escape(head["mesh"])}.</p>
<div class="strip large hero">{shown}</div>
{body}
<footer>Written by <code>{html.escape(head["command"])}</code>. Every number is a row of report.json; every plot lies in plots/ as
SVG and PNG. <code>fastibl report --against report.json</code> later says what became better or worse.</footer>
</main></div></body></html>"""
    page = re.sub(r">\s*\n\s*<", ">\n<", page)
    path = out / "report.html"
    write_whole(path, page)
    return path
