"""The live page as a person uses it, in Chromium: every control, both schemes, a small window."""

import time
from contextlib import contextmanager
from dataclasses import replace

import cv2
import pytest

import fastibl
from bench.live_browser import browser, exercise, missing, open_page, served, wait
from fastibl.live_page import Choices, LiveLoop, Settings
from fastibl.sources import BackAndForth, Paced

if missing():
    pytest.skip(missing(), allow_module_level=True)


@pytest.fixture(scope="module")
def film():
    return fastibl.simulate(seconds=0.6, fps=10, size=(320, 240), truth_size=8, hand=False)


@contextmanager
def pages(film, folder):
    loop = LiveLoop(
        Paced(BackAndForth(film, 0.1), catch_up=0.1),
        Choices(height=0.1),
        Settings("cube"),
        {"distance": 3.0},
        folder=folder,
        about="simulated",
    )
    with served(loop, ("a notice",)) as server, browser() as opened:

        def page(**options):
            made = open_page(opened, server.url, **options)
            made.viewers = server.viewers
            return made

        yield page


@pytest.fixture
def page_of(film, tmp_path):
    with pages(film, tmp_path) as page:
        yield page


def test_every_control(page_of, tmp_path):
    page = page_of()
    done = exercise(page)
    print(f"{len(done)} controls: {', '.join(done)}")
    (recording,) = tmp_path.glob("recording-*")
    assert len(fastibl.Recording.open(recording)) > 2
    (saved,) = tmp_path.glob("picture-*.png")
    assert cv2.imread(str(saved)).shape == (240, 320, 3)
    ids = page.evaluate("[...document.querySelectorAll('button, select, input')].map((e) => e.id)")
    labelled = "(e) => e.labels?.length || e.textContent.trim() || e.getAttribute('aria-label')"
    assert page.evaluate(f"[...document.querySelectorAll('button, select, input')].every({labelled})"), ids
    assert not page.errors and not page.outside
    page.goto("about:blank")
    end = time.monotonic() + 5
    while len(page.viewers) and time.monotonic() < end:
        time.sleep(0.05)
    assert len(page.viewers) == 0, "a page that was left still counts"


@pytest.mark.parametrize("size, scheme", [((1280, 800), "dark"), ((400, 700), "light"), ((320, 256), "light")])
def test_sizes_and_schemes(page_of, size, scheme):
    page = page_of(size=size, color_scheme=scheme)
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), "the page is wider than the window"
    r, g, b = page.evaluate("getComputedStyle(document.body).backgroundColor.match(/\\d+/g).slice(0, 3).map(Number)")
    assert (max(r, g, b) < 60) == (scheme == "dark")
    assert page.evaluate("$('screen').offsetHeight") >= 150  # at 400 % of a small screen, too
    if size[0] >= 1280:  # what is used all the time is seen without scrolling
        assert page.evaluate("$('freeze').getBoundingClientRect().bottom <= innerHeight")
    assert not page.errors and not page.outside


def test_views_are_chosen_as_radio_buttons_are(page_of):
    page = page_of()
    checked = "[...$('views').children].filter((b) => b.ariaChecked === 'true').map((b) => b.dataset.view)"
    names = page.evaluate("[...$('views').children].map((b) => b.dataset.view)")
    page.focus("#views [aria-checked=true]")
    for key, expected in (("ArrowRight", names[1]), ("ArrowRight", names[2 % len(names)]), ("ArrowLeft", names[1])):
        page.keyboard.press(key)
        assert page.evaluate(checked) == [expected] == [page.evaluate("document.activeElement.dataset.view")]
    assert page.evaluate("[...$('views').children].filter((b) => b.tabIndex === 0).length") == 1


@pytest.mark.parametrize(
    "film_of, said",
    [
        (lambda film, back: fastibl.Recording(fastibl.Rig(film.rig.back), back, film.board), "No front camera"),
        (lambda film, back: fastibl.Recording(film.rig, back, film.board), "No picture of the front camera yet"),
    ],
)
def test_a_view_without_a_picture_is_empty(film, tmp_path, film_of, said):
    back = [replace(frame, front=None) for frame in film if frame.back is not None]
    blank = "['picture', 'overlay'].every((id) => { const c = $(id);"
    blank += " return !c.getContext('2d').getImageData(0, 0, c.width, c.height).data.some(Boolean) })"
    with pages(film_of(film, back), tmp_path) as page_of:
        page = page_of()
        page.keyboard.press("a")
        wait(page, f"!({blank})")
        page.keyboard.press("3")
        wait(page, f"!$('hint').hidden && $('hint').textContent.startsWith('{said}')")
        assert page.evaluate(blank)
        page.keyboard.press("1")
        wait(page, f"shown > 0 && !({blank})")
        wait(page, f"$('hint').hidden || !$('hint').textContent.startsWith('{said}')")
        assert not page.errors
