"""What the documents show of reports, by `./dev bench report-pictures`: the overview and the top of the page of a full
report of all real maps, and plots of quick reports. Takes some minutes; nothing else should run at the same time."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from fastibl.__main__ import main as fastibl_command

from . import inputs, live_browser
from .measure import ROOT

_DOCS = ROOT / "docs"
_WIDTH, _HEIGHT, _QUALITY = 1360, 1480, 82
_PLOTS = {
    "capture-error-against-time": "quick",
    "capture-over-time": "quick",
    "tracking-error-against-time": "quick",
    "frame-error-against-time": "venice",
    "self-shadow-error-against-time": "venice",
    "overview": "all",
}


def main() -> Iterator[Path]:
    """Writes the pictures one by one. Raises RuntimeError where there are no real maps, or no browser."""
    if not inputs.MAPS:
        raise RuntimeError(inputs.NO_MAPS)
    if live_browser.missing():
        raise RuntimeError(live_browser.missing())
    reports = {
        "quick": ["--quick"],
        "venice": ["--quick", "--environment", str(inputs.MAPS["venice_sunset"])],
        "all": ["--environment", *map(str, inputs.MAPS.values())],
    }
    with tempfile.TemporaryDirectory() as name:
        for which, arguments in reports.items():
            folder = Path(name) / which
            fastibl_command(["report", *arguments, "--out", str(folder)])
            for plot in (p for p, of in _PLOTS.items() if of == which):
                yield Path(shutil.copy(folder / "plots" / f"{plot}.svg", _DOCS / "plots" / f"report-{plot}.svg"))
        yield _top(folder / "report.html")


def _top(page_file: Path) -> Path:
    path = _DOCS / "images" / "report.jpg"
    with live_browser.browser() as browser:
        page = browser.new_page(viewport={"width": _WIDTH, "height": _HEIGHT})
        page.goto(page_file.as_uri())
        page.screenshot(path=path, type="jpeg", quality=_QUALITY)
    return path
