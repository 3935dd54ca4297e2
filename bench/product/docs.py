"""The documentation: pages without a warning, code blocks that run, and public names that are documented and called."""

from __future__ import annotations

import ast
import importlib.util
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from ..goals import Goal, row, skipped
from ..measure import ROOT

SITE, TESTS = ROOT / "tools" / "site", ROOT / "tests"


def _api():
    for folder in (SITE, TESTS):
        if str(folder) not in sys.path:
            sys.path.insert(0, str(folder))
    import api

    return api


def _used_in_tests() -> set[str]:
    """Names that tests call, read or import, and those in the pages' code blocks, which the tests run."""
    import documents

    texts = [path.read_text("utf-8") for path in TESTS.rglob("*.py")]
    texts += [block.text for block in documents.every_block("python")]
    used: set[str] = set()
    for text in texts:
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Attribute):
                used.add(node.attr)
            elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                used.add(node.func.id)
            elif isinstance(node, ast.keyword) and node.arg:
                used.add(node.arg)
            elif isinstance(node, ast.ImportFrom):
                used |= {alias.name for alias in node.names}
            elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.isidentifier():
                used.add(node.value)  # as in getattr(thing, "name"), where tests have tables of names
    return used


@row("product", "docs")
def docs() -> Iterator[Goal]:
    if not SITE.is_dir():
        yield skipped("docs", "needs the source tree")
        return
    yield from _pages()
    yield from _blocks()
    found = _api().docstrings()
    bare = sorted(name for name, text in found.items() if not text.strip())
    yield Goal(
        "public names with a docstring: functions, classes, methods, properties",
        f"{len(found) - len(bare)} of {len(found)}",
        "all",
        not bare,
        (f"without: {', '.join(bare[:20])}",) if bare else (),
    )
    used = _used_in_tests()
    # A class that calls return, and that nobody makes by hand, counts as used where what it holds is used.
    held = {name.rsplit(".", 1)[0] for name in found if name.rsplit(".", 1)[-1] in used}
    held |= {name for name, thing in _api().documented() if used & set(getattr(thing, "__dataclass_fields__", ()))}
    unused = sorted(name for name in found if name.rsplit(".", 1)[-1] not in used and name not in held)
    yield Goal(
        "public names that a test or a code block calls or reads",
        f"{len(found) - len(unused)} of {len(found)}",
        "all",
        not unused,
        (f"not: {', '.join(unused[:40])}",) if unused else (),
    )


def _pages() -> Iterator[Goal]:
    what = "pages of the site; warnings"
    if any(importlib.util.find_spec(name) is None for name in ("sphinx", "myst_parser", "furo")):
        yield skipped(what, "needs Sphinx, MyST and furo: pip install .[docs]")
        return
    _api()
    import make_site

    with tempfile.TemporaryDirectory() as folder:
        try:
            make_site.build(Path(folder) / "html", Path(folder) / "source")
            warnings: list[str] = []
        except (RuntimeError, ValueError) as error:
            warnings = [line for line in str(error).splitlines() if "WARNING" in line or "ERROR" in line] or [
                str(error)
            ]
        pages = len(list((Path(folder) / "html").rglob("*.html")))
    yield Goal(what, f"{pages}; {len(warnings)}", "0 warnings", not warnings, tuple(warnings[:10]))


def _blocks() -> Iterator[Goal]:
    import documents

    count = {kind: len(documents.every_block(*names)) for kind, names in _KINDS.items()}
    command: list[str | Path] = [sys.executable, "-m", "pytest", "-q", "--no-header", TESTS / "test_documents.py"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    failed = re.findall(r"^FAILED (\S+)", done.stdout, re.M)
    yield Goal(
        "code blocks of README and docs that run (Python, C++) or that the parsers take (shell)",
        ", ".join(f"{n} {kind}" for kind, n in count.items() if n) + f"; {len(failed)} fail",
        "all",
        done.returncode == 0,
        tuple((done.stdout.strip().splitlines() or [""])[-1:] + failed[:10]),
    )


_KINDS = {"Python": ("python",), "shell": ("sh", "bash", "console", "shell"), "C++": ("cpp", "c++"), "JSON": ("json",)}
