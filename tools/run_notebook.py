"""Runs the cells of a notebook in order and keeps what they show, without Jupyter: tools/run_notebook.py FILE

What a cell shows is what it prints, the value of its last line, and the figures that it made. Pictures are stored as
JPEG of at most 900 pixels, so that the file stays small.
"""

from __future__ import annotations

import argparse
import ast
import base64
import contextlib
import io
import json
import os
from pathlib import Path
from typing import Any

WIDEST = 900  # pixels


def run(notebook: dict, folder: Path) -> dict:
    """Runs the notebook in `folder` and returns it with its outputs. Raises RuntimeError that names the cell."""
    import matplotlib

    matplotlib.use("Agg")
    _figures()  # discards figures that were open before: they are not the notebook's
    names: dict[str, Any] = {"__name__": "__main__"}
    number = 0
    with _inside(folder):
        for cell in notebook["cells"]:
            if cell["cell_type"] != "code":
                continue
            number += 1
            try:
                cell["outputs"] = _outputs("".join(cell["source"]), names, number)
            except Exception as error:
                raise RuntimeError(f"code cell {number}: {type(error).__name__}: {error}") from error
            cell["execution_count"] = number
    return notebook


@contextlib.contextmanager
def _inside(folder: Path):
    before = os.getcwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def _outputs(source: str, names: dict[str, Any], number: int) -> list[dict]:
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    printed, value = io.StringIO(), None
    with contextlib.redirect_stdout(printed):
        exec(compile(tree, f"<cell {number}>", "exec"), names)
        if last is not None:
            value = eval(compile(ast.Expression(last.value), f"<cell {number}>", "eval"), names)
    found = []
    if printed.getvalue():
        found.append({"output_type": "stream", "name": "stdout", "text": printed.getvalue().splitlines(keepends=True)})
    figures = _figures()
    if value is not None and not figures:
        result = {"output_type": "execute_result", "execution_count": number, "metadata": {}, "data": _shown(value)}
        found.append(result)
    found += [{"output_type": "display_data", "metadata": {}, "data": figure} for figure in figures]
    return found


def _shown(value: Any) -> dict:
    """What Jupyter would show of a value, by type of content: the picture or the table, and its text."""
    data = {"text/plain": [repr(value)]}
    if hasattr(value, "_repr_png_"):
        data = {"image/jpeg": _jpeg(value._repr_png_()), "text/plain": [f"<{type(value).__name__}>"]}
    elif hasattr(value, "_repr_html_"):
        data = {"text/html": [value._repr_html_()], "text/plain": [f"<{type(value).__name__}>"]}
    return data


def _figures() -> list[dict]:
    from matplotlib import pyplot

    found = []
    for number in pyplot.get_fignums():
        buffer = io.BytesIO()
        pyplot.figure(number).savefig(buffer, format="png", dpi=90)
        found.append({"image/jpeg": _jpeg(buffer.getvalue()), "text/plain": ["<Figure>"]})
    pyplot.close("all")
    return found


def _jpeg(png: bytes) -> str:
    import cv2
    import numpy as np

    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    if image.shape[1] > WIDEST:
        size = WIDEST, round(image.shape[0] * WIDEST / image.shape[1])
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return base64.b64encode(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes()).decode()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    path = parser.parse_args().file.resolve()
    made = run(json.loads(path.read_text("utf-8")), path.parent)
    path.write_text(json.dumps(made, indent=1, ensure_ascii=False) + "\n", "utf-8")
    print(f"{path}: {path.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
