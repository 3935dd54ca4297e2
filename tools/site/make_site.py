"""Builds the site of docs/ to build/site: `./dev docs`. A warning is an error.

The README is its first page; the changelog, the notebook and the pages of the API reference are added. Pages of the
navigation that do not exist are left out. Links to files that are not pages become the files' paths in the repository,
because the site has no address of it.
"""

from __future__ import annotations

import argparse
import posixpath
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SITE = Path(__file__).resolve().parent
sys.path.insert(0, str(SITE))
import api  # noqa: E402
import notebook_page  # noqa: E402

NOTEBOOK = "examples/notebooks/from_capture_to_composite.ipynb"
ADDED = {"index.md": "README.md", "changelog.md": "CHANGELOG.md", "contributing.md": "CONTRIBUTING.md"}
NAVIGATION = {
    "Start": ["getting-started", "notebook", "conventions", "rooms"],
    "Methods": ["capture", "tracking", "light", "shadow", "self-shadow", "plan", "report", "extremes", "comparison"],
    "How to": [
        *("how-to/own-cameras", "how-to/photographs", "how-to/own-renderer", "how-to/change-the-object"),
        *("how-to/on-set", "how-to/in-class", "how-to/pytorch", "how-to/graphics-card"),
        *("live", "program", "embedding", "files", "batch", "package", "faults"),
    ],
    "Reference": [f"api/{page}" for page in api.PAGES],
    "Project": ["contributing", "changelog"],
}
_LINK = re.compile(r"(?<!!)\[((?:[^\]\[]|\[[^\]]*\])+)\]\(([^)#\s]+)(#[^)\s]*)?\)")
_PICTURE = re.compile(r"(!\[[^\]]*\])\(([^)\s]+)\)")
_FENCE = re.compile(r"(^```.*?^```$)", re.M | re.S)


def pages() -> dict[str, tuple[str, str]]:
    """The text of every page by its path, with the file of the repository that it is made from."""
    found = {path.relative_to(ROOT / "docs").as_posix(): path for path in sorted((ROOT / "docs").rglob("*.md"))}
    found |= {page: ROOT / source for page, source in ADDED.items()}
    texts = {page: (path.read_text("utf-8"), path.relative_to(ROOT).as_posix()) for page, path in found.items()}
    if (ROOT / NOTEBOOK).is_file():
        texts["notebook.md"] = (notebook_page.markdown(ROOT / NOTEBOOK, "images/notebook"), NOTEBOOK)
    return texts


def stage(folder: Path) -> None:
    """Writes what Sphinx reads: the pages, with the site's links, and the pictures."""
    shutil.rmtree(folder, ignore_errors=True)
    for part in ("images", "plots"):
        shutil.copytree(ROOT / "docs" / part, folder / part)
    texts = pages()
    for page, (text, source) in texts.items():
        if page == "index.md":
            text += toctrees({*texts, *(f"api/{p}.rst" for p in api.PAGES)})
        (folder / page).parent.mkdir(parents=True, exist_ok=True)
        (folder / page).write_text(linked(text, page, source, texts), "utf-8")
    if (ROOT / NOTEBOOK).is_file():
        notebook_page.write_pictures(ROOT / NOTEBOOK, folder / "images" / "notebook")
    (folder / "api").mkdir(exist_ok=True)
    for page in api.PAGES:
        (folder / "api" / f"{page}.rst").write_text(api.page(page), "utf-8")


def toctrees(present: set[str]) -> str:
    """The navigation, which is put at the end of the first page."""
    out = []
    for title, entries in NAVIGATION.items():
        there = [e for e in entries if f"{e}.md" in present or f"{e}.rst" in present]
        out.append(f"```{{toctree}}\n:hidden:\n:caption: {title}\n\n" + "\n".join(there) + "\n```\n")
    return "\n" + "\n".join(out)


def linked(text: str, page: str, source: str, texts: dict) -> str:
    """The text with its links and pictures changed to those of the site; code stays as it is."""
    parts = _FENCE.split(text)
    made_of = {there: name for name, (_, there) in texts.items()}
    folder, origin = posixpath.dirname(page), posixpath.dirname(source)

    def picture(match: re.Match[str]) -> str:
        there = posixpath.normpath(posixpath.join(origin, match[2]))
        if not there.startswith("docs/") or "://" in match[2]:
            return match[0]
        return f"{match[1]}({posixpath.relpath(there.removeprefix('docs/'), folder or '.')})"

    def link(match: re.Match[str]) -> str:
        label, target, anchor = match[1], match[2], match[3] or ""
        if "://" in target or target.startswith("mailto:"):
            return match[0]
        there = posixpath.normpath(posixpath.join(origin, target))
        if there in made_of:
            return f"[{label}]({posixpath.relpath(made_of[there], folder or '.')}{anchor})"
        if not (ROOT / there).exists():
            raise ValueError(f"{source}: there is no {target}")
        return label if there in label else f"{label} (`{there}`)"

    return "".join(p if k % 2 else _LINK.sub(link, _PICTURE.sub(picture, p)) for k, p in enumerate(parts))


def build(out: Path, staged: Path) -> str:
    """Builds the site; returns what Sphinx printed. Raises RuntimeError with its warnings."""
    stage(staged)
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-E", "-b", "html", "-c", str(SITE), "-d"]
    done = subprocess.run([*command, staged.parent / "doctrees", staged, out], capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(done.stdout + done.stderr)
    return done.stdout + done.stderr


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "site", help="default: build/site")
    out = parser.parse_args().out
    try:
        build(out, out.parent / "site-source")
    except (ValueError, RuntimeError) as error:
        print(error, file=sys.stderr)
        return 1
    print(f"{out / 'index.html'}: {len(list(out.rglob('*.html')))} pages, no warnings")
    return 0


if __name__ == "__main__":
    sys.exit(main())
