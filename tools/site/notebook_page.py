"""A notebook as a page: its text, its code, and the pictures that are stored in it."""

from __future__ import annotations

import base64
import json
from pathlib import Path

_ENDINGS = {"image/png": "png", "image/jpeg": "jpg"}


def cells(path: Path) -> list[dict]:
    return json.loads(path.read_text("utf-8"))["cells"]


def markdown(path: Path, pictures: str) -> str:
    """The page in Markdown. pictures: the folder that write_pictures writes to, relative to the page."""
    out = []
    for index, cell in enumerate(cells(path)):
        text = "".join(cell["source"]).strip()
        if cell["cell_type"] == "markdown":
            out.append(text)
            continue
        out.append(f"```python\n{text}\n```")
        for number, output in enumerate(cell["outputs"]):
            out.append(_output(output, f"{pictures}/{index}-{number}"))
    return "\n\n".join(part for part in out if part) + "\n"


def _output(output: dict, name: str) -> str:
    data = output.get("data", {})
    for kind, ending in _ENDINGS.items():
        if kind in data:
            return f"![what the cell shows]({name}.{ending})"
    if "text/html" in data:
        return "".join(data["text/html"])
    text = "".join(output.get("text", data.get("text/plain", ""))).rstrip()
    return f"```text\n{text}\n```" if text else ""


def write_pictures(path: Path, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for index, cell in enumerate(cells(path)):
        for number, output in enumerate(cell.get("outputs", ())):
            for kind, ending in _ENDINGS.items():
                if kind in output.get("data", {}):
                    content = base64.b64decode("".join(output["data"][kind]))
                    (folder / f"{index}-{number}.{ending}").write_bytes(content)
