"""The notebook runs from its first cell to its last, and what is stored of it is small and whole."""

import base64
import json
import sys

import pytest

from documents import ROOT

FILE = ROOT / "examples" / "notebooks" / "from_capture_to_composite.ipynb"
if not FILE.is_file():
    pytest.skip("needs the source tree", allow_module_level=True)
sys.path.insert(0, str(ROOT / "tools"))

import run_notebook  # noqa: E402


def shown(notebook):
    """What each code cell shows: kinds of content."""
    return [
        [kind for output in cell["outputs"] for kind in output.get("data", {"text": 0}) if kind != "text/plain"]
        for cell in notebook["cells"]
        if cell["cell_type"] == "code"
    ]


def test_it_runs(tmp_path):
    pyplot = pytest.importorskip("matplotlib.pyplot")
    notebook = json.loads(FILE.read_text("utf-8"))
    stored = shown(notebook)
    pyplot.figure()  # of someone else
    assert shown(run_notebook.run(notebook, tmp_path)) == stored
    assert sum("image/jpeg" in kinds for kinds in stored) >= 8 and any("text/html" in kinds for kinds in stored)


def test_what_is_stored_is_small_and_whole():
    assert FILE.stat().st_size < 600_000
    notebook = json.loads(FILE.read_text("utf-8"))
    assert notebook["nbformat"] == 4 and len({cell["id"] for cell in notebook["cells"]}) == len(notebook["cells"])
    for cell in notebook["cells"]:
        for output in cell.get("outputs", ()):
            assert output["output_type"] != "error"
            if "image/jpeg" in output.get("data", {}):
                assert base64.b64decode(output["data"]["image/jpeg"])[:2] == b"\xff\xd8"


def test_an_error_names_its_cell(tmp_path):
    pytest.importorskip("matplotlib")
    cells = [{"cell_type": "code", "source": ["a = 1\n"]}, {"cell_type": "code", "source": ["b\n"]}]
    with pytest.raises(RuntimeError, match="code cell 2: NameError"):
        run_notebook.run({"cells": cells}, tmp_path)
    assert cells[0]["execution_count"] == 1 and "execution_count" not in cells[1]
