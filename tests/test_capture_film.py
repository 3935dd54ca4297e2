"""Capture from films: what a picture may leave out, and what it must not."""

import numpy as np
import pytest

import fastibl
from views import camera_of, exposed, looking, picture_of, rays_of

SIZE, RATE = 128, 30
MOST_LEFT_OUT = 5  # pictures in a row that may leave out a tile
TOWARDS = (0.3, 1.0, 0.9)


def place(directions):
    x, y, z = np.moveaxis(np.asarray(directions, np.float64), -1, 0)
    light = 0.3 + 0.1 * np.sin(5 * x + 3 * y) * np.cos(4 * z) + 0.05 * np.sin(23 * x + 17 * z)
    return np.stack([light, 0.8 * light, 0.9 * light], axis=-1)


class Film:
    """A camera that stands still; pictures of `place` with noise, and which tiles each changed."""

    def __init__(self, seed=0, **options):
        self.camera, self.pose = camera_of(320, 240, 60.0, **options), looking(TOWARDS, eye=(0, -0.2, 0.3))
        self.light = picture_of(place, self.camera, self.pose)
        self.rays = rays_of(self.camera, self.pose)
        self.capture, self.rng, self.time, self.changed = fastibl.Capture(size=SIZE), np.random.default_rng(seed), 0, []

    def add(self, light=None, exposure=1.0):
        light = self.light if light is None else light
        codes = exposed(light, self.camera, exposure) + self.rng.normal(size=(240, 320, 1)).round()
        before = self.capture.environment().radiance.tile_versions.copy()
        self.capture.add(
            np.clip(codes, 0, 255).astype(np.uint8), self.camera, self.pose, exposure=exposure, time=self.time / RATE
        )
        self.time += 1
        self.changed.append(self.capture.environment().radiance.tile_versions != before)
        return self

    def film(self, count, **others):
        for _ in range(count):
            self.add(**others)
        return self

    @property
    def seen(self):
        return np.isfinite(self.capture.last_seen)

    @property
    def tiles(self):
        """Tiles of which all texels were seen."""
        edge = SIZE // 16
        return self.seen.reshape(6, 16, edge, 16, edge).all(axis=(2, 4))

    @property
    def faces(self):
        return self.capture.environment().radiance.faces


def inner(film, degrees):
    """Texels well inside of the picture, and their angle from its axis."""
    axis = np.asarray(TOWARDS) / np.linalg.norm(TOWARDS)
    angle = np.degrees(np.arccos(np.clip(fastibl.texel_directions(SIZE) @ axis, -1, 1)))
    return film.seen & (angle < degrees)


def relative(estimate, truth):
    return np.abs(estimate / truth - 1).max(axis=-1)


def test_most_tiles_are_left_out_but_none_for_long():
    film = Film().film(40)
    tiles = film.tiles
    taken = np.array([c[tiles] for c in film.changed])
    shares = taken.mean(axis=1)
    print(f"{tiles.sum()} tiles, shares taken: {np.round(shares, 2)}")
    assert taken[0].all() and np.median(shares[8:]) < 0.3
    turn = MOST_LEFT_OUT + 1
    assert all(taken[k : k + turn].any(axis=0).all() for k in range(len(taken) - turn + 1))
    env = film.capture.environment()
    inside = inner(film, 15)
    assert env.age[inside].max() <= (MOST_LEFT_OUT + 0.01) / RATE
    error = relative(film.faces[inside], place(fastibl.texel_directions(SIZE))[inside])
    print(f"error: median {100 * np.median(error):.2f} %, worst {100 * error.max():.1f} %")
    assert np.median(error) < 0.01 and error.max() < 0.06


@pytest.mark.parametrize("factor", [0.5, 0.9, 1.1, 2.0])
def test_changed_light_comes_through_at_once(factor):
    film = Film().film(17)
    film.add(factor * film.light)
    inside = inner(film, 15)
    moved = film.faces[inside] / place(fastibl.texel_directions(SIZE))[inside]
    assert film.changed[-1][film.tiles].all()
    # What contradicts is replaced, the rest is averaged: at once it goes at least a third of the way.
    way = (np.median(moved) - 1) / (factor - 1)
    print(f"light times {factor}: {way:.2f} of the way after one picture")
    assert way > 0.33


@pytest.mark.parametrize("level", [0.0, 3.0])
def test_a_hand_and_a_lamp_come_through_at_once(level):
    """Six degrees wide, at any place and in any frame of the film."""
    film = Film().film(16)
    rng = np.random.default_rng(1)
    for k in range(6):
        film.film(1 + k % 4)
        middle = film.rays[rng.integers(60, 180), rng.integers(80, 240)]
        angle = np.degrees(np.arccos(np.clip(film.rays @ middle, -1, 1)))
        film.add(np.where((angle < 3)[..., None], level, film.light))
        inside = np.degrees(np.arccos(np.clip(fastibl.texel_directions(SIZE) @ middle, -1, 1))) < 2
        values = film.faces[inside & film.seen]
        assert len(values) > 10
        assert (values < 0.02).all() if level == 0 else (values > 0.9).all()


def test_a_small_change_is_five_pictures_late_at_most():
    film = Film().film(16)
    film.film(MOST_LEFT_OUT + 1, light=1.01 * film.light)
    assert np.any(film.changed[-MOST_LEFT_OUT - 1 :], axis=0)[film.tiles].all()


def test_bounds_are_lifted_at_once():
    film = Film()
    middle = film.rays[120, 160]
    lamp = np.degrees(np.arccos(np.clip(film.rays @ middle, -1, 1))) < 8
    light = np.where(lamp[..., None], 40.0, film.light)
    film.film(12, light=light)
    inside = np.degrees(np.arccos(np.clip(fastibl.texel_directions(SIZE) @ middle, -1, 1))) < 6
    assert film.capture.environment().clipped > 0
    left_out = ~film.changed[-1][film.tiles].all()
    film.add(light, exposure=1 / 100)
    print(f"lamp of 40: {np.median(film.faces[inside]):.1f}")
    np.testing.assert_allclose(film.faces[inside], 40, rtol=0.05)
    assert left_out and film.capture.environment().clipped == 0


def test_exposures_that_say_more_are_taken():
    """After short exposures, in which dark parts are a few codes, the first long one is taken everywhere."""
    film = Film()
    film.light = 0.1 * film.light
    film.film(12, exposure=0.3)
    assert not film.changed[-1][film.tiles].all()
    film.add(exposure=10.0)
    assert film.changed[-1][film.tiles].all()
    inside = inner(film, 15)
    error = relative(film.faces[inside], 0.1 * place(fastibl.texel_directions(SIZE))[inside])
    print(f"after one long exposure: median {100 * np.median(error):.2f} %")
    assert np.median(error) < 0.02


def test_brackets_leave_out_no_exposure_for_good():
    """A lamp and the dark beside it, each measured by one exposure of a bracket of three, four or five."""
    for count in (3, 4, 5):
        film = Film()
        middle = film.rays[120, 160]
        lamp = np.degrees(np.arccos(np.clip(film.rays @ middle, -1, 1))) < 8
        light = np.where(lamp[..., None], 40.0, 0.02 * film.light)
        for k in range(6 * count):
            film.add(light, exposure=[16.0, 1.0, 1 / 64, 4.0, 1 / 8][k % count])
        angle = np.degrees(np.arccos(np.clip(fastibl.texel_directions(SIZE) @ middle, -1, 1)))
        dark = film.seen & (angle > 11) & inner(film, 15)
        bright = relative(film.faces[angle < 6], 40)
        error = relative(film.faces[dark], 0.02 * place(fastibl.texel_directions(SIZE))[dark])
        print(f"bracket of {count}: lamp {100 * np.median(bright):.2f} %, dark {100 * np.median(error):.2f} %")
        assert film.capture.environment().clipped == 0
        assert np.median(bright) < 0.03 and np.median(error) < 0.03


def test_threads_and_replay_give_the_same_bits():
    maps, before = [], fastibl.threads()
    try:
        for count in (1, 2, 1):
            fastibl.set_threads(count)
            film = Film(vignetting=(-0.3, 0.05)).film(25)
            assert not film.changed[-1][film.tiles].all()
            env = film.capture.environment()
            maps.append((film.faces.tobytes(), env.confidence.tobytes(), env.age.tobytes(), env.predicted_error))
    finally:
        fastibl.set_threads(before)
    assert maps[0] == maps[1] == maps[2]
