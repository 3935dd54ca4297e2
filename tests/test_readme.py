"""The README's Python blocks run as they stand."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest

README = Path(__file__).resolve().parents[1] / "README.md"


@pytest.mark.parametrize("index", [0, 1])
def test_python_blocks_run(index, tmp_path, monkeypatch, capsys):
    blocks = re.findall(r"```python\n(.*?)```", README.read_text(), re.S)
    assert len(blocks) == 2
    monkeypatch.chdir(tmp_path)
    cv2.imwrite("room.hdr", np.random.default_rng(0).random((32, 64, 3)).astype(np.float32))
    exec(compile(("import fastibl\n" if index else "") + blocks[index], f"README block {index}", "exec"), {})
    if index == 0:
        printed = capsys.readouterr().out
        assert "composite" in printed and "Comparison(" in printed
