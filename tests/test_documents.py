"""README and docs/: every code block runs or is checked against the real parsers, and links lead somewhere."""

import argparse
import importlib.util
import re
import shlex
import shutil
import subprocess
from urllib.parse import urlsplit

import pytest
import tomllib

import documents
from document_setups import CPP_PRELUDES, namespace_of
from fastibl.__main__ import build_parser

ROOT = documents.ROOT
if not (ROOT / "docs").is_dir():
    pytest.skip("needs the source tree", allow_module_level=True)

PYTHON = {
    b.page: [x for x in documents.every_block("python") if x.page == b.page] for b in documents.every_block("python")
}


@pytest.mark.parametrize("page", PYTHON)
def test_python_blocks_run(page, tmp_path, monkeypatch, capsys):
    """The blocks of a page one after the other, as a reader would type them, after the page's set-up."""
    monkeypatch.chdir(tmp_path)
    names = namespace_of(page, tmp_path, monkeypatch)
    for block in PYTHON[page]:
        code = "\n" * block.line + block.text
        exec(compile(code, str(ROOT / page), "exec"), names)
    printed = capsys.readouterr().out
    if page == "README.md":
        assert "composite" in printed and "median over normals" in printed


def options_of(parser):
    return {option for action in parser._actions for option in action.option_strings}


def fastibl_command(words):
    """The command's own parser takes the words. Files need not be there."""
    for word in [w for w in words if w.startswith("-")]:
        assert "…" not in word
    try:
        build_parser().parse_args(words)
    except SystemExit as left:
        assert left.code == 0, f"fastibl {' '.join(words)}"


def dev_command(words):
    cases = re.findall(r"^  ([a-z |]+)\)$", (ROOT / "dev").read_text(), re.M)
    assert words and words[0] in {name.strip() for case in cases for name in case.split("|")}, words


def demo_program(words):
    known = set(re.findall(r'"(--[a-z-]+)[",]', "".join(p.read_text() for p in (ROOT / "cpp/demo").glob("*.cpp"))))
    assert {w for w in words if w.startswith("-")} <= known | {"--help"}, words


def cmake(words):
    text = (ROOT / "CMakeLists.txt").read_text()
    for name in (w[2:].split("=")[0] for w in words if w.startswith("-DFASTIBL")):
        assert re.search(rf"option\(\s*{name}\b", text), name
    sources = [words[k + 1] for k, w in enumerate(words[:-1]) if w == "-S"]
    assert all((ROOT / s / "CMakeLists.txt").is_file() for s in sources), words


def pip(words):
    assert words[0] == "install", words
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    for word in words[1:]:
        name, _, extras = word.strip("'\"").partition("[")
        if name in (".", "fastibl"):
            given = {e.strip() for e in extras.rstrip("]").split(",") if e}
            assert given <= set(project["optional-dependencies"]), word


def python(words):
    if words[:1] == ["-m"]:
        assert importlib.util.find_spec(words[1]), words
    elif words and words[0].endswith(".py"):
        assert (ROOT / words[0]).is_file() or list((ROOT / "examples").rglob(words[0])), words


def plain(words):
    """What every shell has."""


PROGRAMS = {
    "fastibl": fastibl_command, "./dev": dev_command, "cmake": cmake, "pip": pip, "python": python, "python3": python,
    "fastibl-demo": demo_program, "./fastibl-demo": demo_program, "build/cpp/cpp/demo/fastibl-demo": demo_program,
    **dict.fromkeys(("apt-get", "git", "cd", "mkdir", "ls", "kill", "curl", "docker", "ninja", "ctest"), plain),
}  # fmt: skip


@pytest.mark.parametrize("block", documents.every_block("sh", "bash", "console", "shell"), ids=str)
def test_shell_blocks_name_what_there_is(block):
    lines = documents.commands(block)
    assert lines
    for line in lines:
        words = [w for w in shlex.split(line.removeprefix("$ ")) if not re.fullmatch(r"[A-Z_]+=\S*", w)]
        program = words[0].removeprefix(".venv/bin/").removeprefix("sudo ") if words else ""
        assert not words or program in PROGRAMS, f"{block}: {line}"
        if words:
            PROGRAMS[program](words[1:])


@pytest.mark.parametrize("block", documents.every_block("ini"), ids=str)
def test_units_start_what_there_is(block):
    (line,) = re.findall(r"^ExecStart=(.*)$", block.text.replace("\\\n", " "), re.M)
    program, *words = shlex.split(line)
    PROGRAMS[program.rpartition("/")[2]](words)


@pytest.mark.parametrize("block", documents.every_block("cpp", "c++"), ids=str)
def test_cpp_blocks_compile(block, tmp_path):
    """A whole program as it stands; statements within a function, after the includes."""
    if not shutil.which("g++"):
        pytest.skip("needs g++")
    text = block.text
    if not re.search(r"\bmain\(|^(struct|class|void|int|auto) ", text, re.M):
        includes = [line for line in text.splitlines() if line.startswith("#include")]
        rest = [line for line in text.splitlines() if not line.startswith("#include")]
        prelude = CPP_PRELUDES.get(block.page, "void block() {")
        text = "\n".join([*includes, prelude, *rest, "}"])
    (tmp_path / "block.cpp").write_text(text)
    command = ["g++", "-std=c++20", "-fsyntax-only", f"-I{ROOT / 'cpp'}", f"-I{ROOT}", "block.cpp"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    absent = re.search(r"fatal error: ((?:glm|epoxy|opencv2)/\S+): No such file", done.stderr)
    if absent:
        pytest.skip(f"needs {absent[1]}")
    assert done.returncode == 0, f"{block}\n{done.stderr[:2000]}"


def test_blocks_say_what_they_are():
    """A block without a language is a drawing or what a program prints, not something to type."""
    for page in documents.pages():
        for block in documents.blocks(page):
            known = {
                "python",
                "sh",
                "bash",
                "console",
                "shell",
                "cpp",
                "c++",
                "cmake",
                "json",
                "text",
                "html",
                "ini",
                "js",
                "yaml",
                "",
            }
            assert block.language in known, str(block)
            if block.language in ("", "text"):
                assert not re.search(r"^(\$ |\./dev |fastibl [a-z]+ |import |cmake |pip )", block.text, re.M), str(
                    block
                )


@pytest.mark.parametrize(
    "page", [*documents.pages(), ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md"], ids=lambda p: p.name
)
def test_links_lead_somewhere(page):
    for link in documents.links(page):
        parts = urlsplit(link)
        if parts.scheme:
            assert parts.scheme in ("https", "mailto") and (parts.netloc or parts.path), f"{page.name}: {link}"
            continue
        target = (page.parent / parts.path).resolve() if parts.path else page
        assert target.exists(), f"{page.name}: {link}"
        assert target.is_relative_to(ROOT), f"{page.name}: {link}"
        if parts.fragment and target.suffix == ".md":
            assert parts.fragment in documents.anchors(target), f"{page.name}: {link}"


def test_readme_is_short():
    assert len((ROOT / "README.md").read_text("utf-8").splitlines()) <= 120


def test_commands_are_all_in_the_readme():
    parser = build_parser()
    sub = next(a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    text = (ROOT / "README.md").read_text("utf-8")
    for name in sub.choices:
        assert f"`fastibl {name}" in text, f"README does not name `fastibl {name}`"
