"""The site builds without a warning, has every public name, renders docstrings, and asks nothing outside."""

import html
import importlib.util
import inspect
import re
import sys

import pytest

import fastibl
from documents import ROOT

SITE = ROOT / "tools" / "site"
if not SITE.is_dir():
    pytest.skip("needs the source tree", allow_module_level=True)
sys.path.insert(0, str(SITE))

import api  # noqa: E402
import docstrings  # noqa: E402
import make_site as site_build  # noqa: E402


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    for needed in ("sphinx", "myst_parser", "furo"):
        if importlib.util.find_spec(needed) is None:
            pytest.skip("needs Sphinx, MyST and furo: pip install .[docs]")
    folder = tmp_path_factory.mktemp("site")
    site_build.build(folder / "html", folder / "source")
    return folder / "html"


def test_every_public_name_is_on_one_page():
    named = [name for page in api.PAGES for name in api.names(page)]
    assert len(named) == len(set(named))
    missing = set(fastibl.__all__) - set(named) - {"__version__"}
    assert not missing, f"not in tools/site/api.py: {', '.join(sorted(missing))}"


def test_every_public_name_has_a_docstring():
    """Functions, classes, their methods and properties, and those of public modules."""
    bare = [name for name, text in api.docstrings().items() if not text.strip()]
    assert not bare, f"{len(bare)} without a docstring: {', '.join(sorted(bare))}"


def test_every_page_is_in_the_site(site):
    for page in site_build.pages():
        assert (site / page).with_suffix(".html").is_file(), page
    text = (site / "index.html").read_text("utf-8")
    entries = {entry for group in site_build.NAVIGATION.values() for entry in group}
    for page in site_build.pages():
        if page != "index.md":
            assert page.removesuffix(".md") in entries, f"{page} is not in NAVIGATION of tools/site/make_site.py"
            assert page.replace(".md", ".html") in text, f"{page} is not in the navigation"


def test_every_public_name_is_in_the_reference(site):
    shown = set(re.findall(r'id="(fastibl\.[\w.]+)"', "".join(p.read_text("utf-8") for p in site.glob("api/*.html"))))
    for name, thing in api.documented():
        if not inspect.ismodule(thing) and name not in ("fastibl.simulate",):
            assert name in shown, name
    assert "fastibl.simulate" in shown and "fastibl.Lighting.irradiance" in shown


def test_docstrings_render(site):
    """No markup of reStructuredText is left in the text, and explained parameters are lists."""
    for path in site.glob("api/*.html"):
        text = html.unescape(
            re.sub(r"<[^>]+>", "", re.sub(r"<(script|style).*?</\1>", "", path.read_text("utf-8"), flags=re.S))
        )
        for wrong in ("``", ":param", "SupportsFloat", "fastibl._fastibl", "\\*", "Traceback"):
            assert wrong not in text, f"{path.name}: {wrong}"
    text = (site / "api" / "maps.html").read_text("utf-8")
    assert re.search(r"<li><p><strong>directions</strong>: \(…, 3\) any float dtype", text)


def test_nothing_is_asked_outside(site):
    """No script, style, font or picture comes from another address."""
    for path in site.rglob("*.html"):
        text = path.read_text("utf-8")
        for tag in re.findall(r"<(?:script|link|img|iframe|source)\b[^>]*>", text):
            assert not re.search(r'(?:src|href)="(?:https?:)?//', tag) or 'rel="canonical"' in tag, (
                f"{path.name}: {tag}"
            )
    for path in site.rglob("*.css"):
        assert not re.search(r"url\(['\"]?(?:https?:)?//|@import", path.read_text("utf-8")), path.name


def test_a_broken_link_fails_the_build(tmp_path, monkeypatch):
    pages = dict(site_build.pages())
    pages["rooms.md"] = ("# Rooms\n\n[gone](nowhere.md)\n", "docs/rooms.md")
    monkeypatch.setattr(site_build, "pages", lambda: pages)
    with pytest.raises(ValueError, match="nowhere.md"):
        site_build.stage(tmp_path / "source")


def test_links_to_files_become_their_paths():
    texts = {"light.md": ("", "docs/light.md"), "index.md": ("", "README.md")}
    text = "[rows](../bench/results) ![a](plots/b.svg) [start](../README.md#what-it-does) [w](https://a.org/b)"
    made = site_build.linked(text, "light.md", "docs/light.md", texts)
    assert made == "rows (`bench/results`) ![a](plots/b.svg) [start](index.md#what-it-does) [w](https://a.org/b)"
    code = "```\n[no](link.md)\n```"
    assert site_build.linked(code, "light.md", "docs/light.md", texts) == code


@pytest.mark.parametrize(
    "text, names, made",
    [
        (
            "Takes a. a: one thing, (n, 3). b: another.",
            {"a", "b"},
            "Takes a.\n\n* **a**: one thing, (n, 3).\n* **b**: another.",
        ),
        ("a: of `b`. Raises ValueError.", {"a"}, "* **a**: of ``b``.\n\nRaises ValueError."),
        ("x * y and z_ |n|", set(), "x \\* y and z\\_ \\|n\\|"),
        ("- one\n  more\n- two", set(), "* one more\n* two"),
    ],
)
def test_docstrings_as_restructured_text(text, names, made):
    assert "\n".join(docstrings.rst([text], names)).strip() == made


def test_signatures_are_short():
    assert (
        docstrings.shorter("(self: fastibl._fastibl.CubeMap, k: typing.SupportsInt | typing.SupportsIndex)")
        == "(k: int)"
    )
    assert docstrings.extension_signature(fastibl.CubeMap) == ("(faces: ArrayLike)", "")
