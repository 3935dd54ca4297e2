"""A newcomer's first minutes: the README's code blocks, to the letter, in a clean root file system.

Needs root, debootstrap and the package indexes of this machine. The clean Debian 12 is made once and kept as a tar in
FASTIBL_BENCH_CACHE (default ~/.cache/fastibl-bench). What is cloned is the commit that is checked out.
FASTIBL_NEWCOMER=all also runs the native program's block (a quarter of an hour of one core).
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import stat
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ..goals import Goal, row, skipped
from ..measure import ROOT

CACHE = Path(os.environ.get("FASTIBL_BENCH_CACHE", "~/.cache/fastibl-bench")).expanduser()
BASE = CACHE / "bookworm-minbase.tar"
WHAT = "README's code blocks in a clean Debian 12"
PICTURE = "root/fastibl/demo/picture.jpg"
# This machine's settings: where packages come from, and which certificates and keys it trusts.
SETTINGS = (
    "etc/resolv.conf", "etc/apt/sources.list", "etc/apt/sources.list.d/debian.sources", "etc/apt/apt.conf.d",
    "etc/pip.conf", "etc/ssl/certs/ca-certificates.crt", "usr/share/keyrings/debian-archive-keyring.gpg",
)  # fmt: skip
NEEDS_A_PERSON = ("--back 0", "a window")  # words in lines that need cameras or a screen


@dataclass
class Step:
    """A command of the README or a Python block, and its result."""

    text: str
    seconds: float = 0.0
    cpu: float = 0.0
    output: str = ""
    code: int = 0


def missing() -> str | None:
    """Why this cannot be measured here."""
    if os.geteuid() != 0:
        return "needs root, for chroot"
    if not BASE.is_file() and shutil.which("debootstrap") is None:
        return "needs debootstrap"
    if not (ROOT / ".git").exists():
        return "needs the repository"
    return None


def blocks() -> list[tuple[str, str]]:
    """Language and text of the README's code blocks, in order."""
    return re.findall(r"^```(\w+)\n(.*?)^```$", (ROOT / "README.md").read_text("utf-8"), re.M | re.S)


def commands(text: str) -> list[str]:
    """Lines of a shell block, without comments and without those that need a person."""
    lines = [line for line in text.splitlines() if not any(word in line for word in NEEDS_A_PERSON)]
    cut = [re.sub(r"(^|\s)#.*", "", line).strip() for line in lines]
    return [line for line in cut if line]


def make_root(root: Path) -> None:
    """Makes a clean Debian 12 with this machine's package indexes, and the repository at an address from which to
    clone."""
    if not BASE.is_file():
        CACHE.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=CACHE) as folder:
            include = "--include=ca-certificates"
            subprocess.run(["debootstrap", "--variant=minbase", include, "bookworm", folder], check=True)
            subprocess.run(["tar", "-C", folder, "-cf", BASE.with_suffix(".part"), "."], check=True)
        BASE.with_suffix(".part").rename(BASE)
    subprocess.run(["tar", "-C", root, "-xf", BASE], check=True)
    for name in SETTINGS:
        here, there = Path("/") / name, root / name
        if here.is_dir():
            shutil.copytree(here, there, dirs_exist_ok=True)
        elif here.is_file():
            there.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(here, there)
    if (root / "etc/apt/sources.list.d/debian.sources").is_file():
        (root / "etc/apt/sources.list").unlink(missing_ok=True)
    subprocess.run(["git", "clone", "-q", "--bare", ROOT, root / "srv/fastibl.git"], check=True)
    head = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, check=True, capture_output=True, text=True)
    bare: list[str | Path] = ["git", "-C", root / "srv/fastibl.git"]
    subprocess.run([*bare, "update-ref", "refs/heads/first-minutes", head.stdout.strip()], check=True)
    subprocess.run([*bare, "symbolic-ref", "HEAD", "refs/heads/first-minutes"], check=True)


class Root:
    """A root file system in which commands run; what they mount is visible to them alone and goes away with them."""

    def __init__(self, path: Path):
        self.path, self.folder = path, "/root"
        for name, minor in (("null", 3), ("zero", 5), ("full", 7), ("random", 8), ("urandom", 9)):
            if not (path / "dev" / name).exists():
                os.mknod(path / "dev" / name, 0o666 | stat.S_IFCHR, os.makedev(1, minor))

    def run(self, text: str) -> Step:
        """Runs one line in a shell that begins in the folder in which the line before ended."""
        script = f"cd {shlex.quote(self.folder)}\n{text}\ncode=$?\npwd >/tmp/folder\nexit $code\n"
        root = shlex.quote(str(self.path))
        enter = f'mount -t proc proc {root}/proc && exec chroot {root} /bin/bash -c "$0"'
        clean = {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "HOME": "/root", "LANG": "C.UTF-8"}
        clean |= {name: value for name, value in os.environ.items() if name in ("PIP_CERT", "SSL_CERT_FILE")}
        before, begin = os.times(), time.perf_counter()
        done = subprocess.run(
            ["unshare", "--mount", "/bin/sh", "-c", enter, script], env={**clean, "DEBIAN_FRONTEND": "noninteractive"},
            text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
        )  # fmt: skip
        after = os.times()
        cpu = after.children_user + after.children_system - before.children_user - before.children_system
        if (self.path / "tmp/folder").is_file():
            self.folder = (self.path / "tmp/folder").read_text().strip()
        return Step(text, time.perf_counter() - begin, cpu, done.stdout, done.returncode)


class _Watch:
    """Notes when a file first exists."""

    def __init__(self, path: Path):
        self._path, self._begin = path, time.perf_counter()
        self._at: float | None = None
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._thread.start()

    def _look(self) -> None:
        while self._at is None:
            if self._path.is_file() and self._path.stat().st_size:
                self._at = time.perf_counter() - self._begin
            time.sleep(0.2)

    def seconds(self) -> float | None:
        return self._at


def walk(root: Root) -> Iterator[Step]:
    """Every block in order, until one fails."""
    for number, (language, text) in enumerate(blocks()):
        if language == "sh" and (number == 0 or os.environ.get("FASTIBL_NEWCOMER") == "all"):
            for line in commands(text):
                yield root.run(line.replace("<this repository>", "/srv/fastibl.git"))
        elif language == "python":
            step = root.run(f".venv/bin/python - <<'END'\n{text}END")
            yield Step(f"Python block {number}", step.seconds, step.cpu, step.output, step.code)


@row("product", "newcomer")
def newcomer() -> Iterator[Goal]:
    reason = missing()
    if reason:
        yield skipped(WHAT, reason)
        return
    folder = Path(tempfile.mkdtemp(prefix="newcomer-", dir=CACHE if CACHE.is_dir() else None))
    try:
        make_root(folder)
        yield from _goals(Root(folder))
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _goals(root: Root) -> Iterator[Goal]:
    done, seen = [], _Watch(root.path / PICTURE)
    for step in walk(root):
        done.append(step)
        if step.code:
            break
    at = seen.seconds()
    notes = tuple(f"{s.seconds:.0f} s ({s.cpu:.0f} s of a core): {s.text.splitlines()[0]}" for s in done)
    failed = [s for s in done if s.code]
    notes += tuple(f"{s.text.splitlines()[0]}: {line}" for s in failed for line in s.output.splitlines()[-8:])
    yield Goal(
        WHAT,
        f"{len(done)} steps, {len(failed)} failed" + (f": {failed[0].text.splitlines()[0]}" if failed else ""),
        "no step missing",
        not failed,
        notes,
    )
    count = next((k for k in range(1, len(done) + 1) if at is not None and sum(s.seconds for s in done[:k]) >= at), 0)
    yield Goal(
        "first picture",
        "none" if at is None else f"{count} commands, {at / 60:.1f} min",
        "≤ 3 commands, ≤ 5 min",
        at is not None and count <= 3 and at <= 300,
        (f"load of the machine meanwhile: {os.getloadavg()[2]:.1f} on {os.cpu_count()} cores",),
    )
