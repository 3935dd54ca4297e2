"""Shared parts of pages: the style, pictures and plots within the page, tables."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

STYLE = """
:root { --ink: #1c2430; --soft: #5c6773; --line: #dfe4ea; --accent: #0b6e99; --warm: #b4552d; }
* { box-sizing: border-box; }
body { font: 16px/1.55 system-ui, sans-serif; color: var(--ink); max-width: 1080px; margin: 2.5rem auto; padding: 0 1.2rem; }
h1 { font-size: 2rem; margin: 0 0 .3rem; } h2 { margin: 2.6rem 0 .6rem; font-size: 1.35rem; }
p.lead { font-size: 1.12rem; color: var(--soft); margin-top: 0; }
table { border-collapse: collapse; width: 100%; margin: .8rem 0; font-variant-numeric: tabular-nums; }
th, td { text-align: right; padding: .35rem .6rem; border-bottom: 1px solid var(--line); }
th:first-child, th.note, td:first-child { text-align: left; } th { color: var(--soft); font-weight: 600; font-size: .9rem; }
td.note { text-align: left; color: var(--soft); font-size: .9rem; }
.row { display: grid; grid-template-columns: repeat(auto-fit, minmax(240px, 1fr)); gap: .8rem; margin: .8rem 0; }
figure { margin: 0; } figcaption { font-size: .88rem; color: var(--soft); }
img, video { width: 100%; border-radius: 6px; display: block; background: #000; }
img.plot { background: none; } code, pre { font-size: .88rem; } pre { background: #f5f7f9; padding: .9rem; overflow-x: auto; border-radius: 6px; }
.numbers { display: grid; grid-template-columns: repeat(auto-fit, minmax(180px, 1fr)); gap: .8rem; margin: 1.2rem 0; }
.numbers div { border: 1px solid var(--line); border-radius: 8px; padding: .7rem .9rem; }
.numbers b { display: block; font-size: 1.5rem; color: var(--accent); } .numbers span { color: var(--soft); font-size: .9rem; }
"""


def data(picture: NDArray[np.uint8], kind: str = "jpg") -> str:
    """A picture (h, w, 3) RGB as a data URI."""
    options = [cv2.IMWRITE_JPEG_QUALITY, 90] if kind == "jpg" else []
    ok, encoded = cv2.imencode(f".{kind}", np.ascontiguousarray(picture[..., ::-1]), options)
    if not ok:
        raise OSError("a picture of the report cannot be encoded")
    mime = "jpeg" if kind == "jpg" else kind
    return f"data:image/{mime};base64,{base64.b64encode(encoded.tobytes()).decode()}"


def figure(picture: NDArray[np.uint8], caption: str) -> str:
    """A picture and its caption."""
    text = html.escape(caption)
    return f'<figure><img src="{data(picture)}" alt="{text}"><figcaption>{text}</figcaption></figure>'


def svg_data(svg: bytes) -> str:
    return f"data:image/svg+xml;base64,{base64.b64encode(svg).decode()}"


def plot(figure) -> str:
    """A matplotlib figure as a picture within the page."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg", bbox_inches="tight")
    return f'<img class="plot" alt="plot" src="{svg_data(buffer.getvalue())}">'


def table(head: list[str], rows: Sequence[tuple[str, ...]], note_last: bool = False) -> str:
    """A table of texts. note_last: whether the last column is prose."""
    heads = [f"<th>{html.escape(h)}</th>" for h in head]
    if note_last:
        heads[-1] = f'<th class="note">{html.escape(head[-1])}</th>'
    out = ["<table><thead><tr>", *heads, "</tr></thead><tbody>"]
    for row in rows:
        cells = [f"<td>{html.escape(c)}</td>" for c in row]
        if note_last:
            cells[-1] = f'<td class="note">{html.escape(row[-1])}</td>'
        out.append("<tr>" + "".join(cells) + "</tr>")
    return "".join(out) + "</tbody></table>"
