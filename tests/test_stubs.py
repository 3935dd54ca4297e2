"""The stored type stub is that of the extension. `./dev stubs` writes it anew."""

import ast
from pathlib import Path

import pytest

import fastibl
import stubs

pytest.importorskip("pybind11_stubgen")


def blocks(text):
    """Definitions by name, and all other lines: their order may differ between versions of the generator."""
    tree = ast.parse(text)
    return {getattr(node, "name", None) or ast.unparse(node): ast.unparse(node) for node in tree.body}


def test_the_stub_is_up_to_date():
    stored, made = blocks(stubs.STUB.read_text()), blocks(stubs.generate())
    different = sorted(name[:60] for name in stored.keys() | made.keys() if stored.get(name) != made.get(name))
    assert not different, f"run ./dev stubs; different: {', '.join(different)}"


def test_every_public_name_has_a_stub():
    names = blocks(stubs.STUB.read_text())
    core = [n for n in fastibl.__all__ if getattr(getattr(fastibl, n), "__module__", "") == "fastibl._fastibl"]
    assert len(core) > 20
    for name in core:
        assert name in names, f"{name} has no stub: run ./dev stubs"


def test_the_package_says_that_it_is_typed():
    folder = Path(fastibl.__file__).parent
    assert (folder / "py.typed").exists() and (folder / "_fastibl.pyi").exists()
