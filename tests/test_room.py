"""The built-in room: its light is plausible, its radiance belongs to places, its truth is what rays see."""

import numpy as np
import pytest

import fastibl
from fastibl import reference
from fastibl.room import (
    _LAMP_CENTRE,
    LOWER,
    OBJECT,
    UPPER,
    Room,
    _rectangle_irradiance,
    table_albedo,
    wood,
)


@pytest.fixture(scope="module")
def room():
    return Room()


def points_on_walls(rng, count=300):
    points = rng.uniform(LOWER + 0.05, UPPER - 0.05, (count, 3))
    axis, side = rng.integers(0, 3, count), rng.integers(0, 2, count)
    points[np.arange(count), axis] = np.where(side, UPPER[axis], LOWER[axis])
    return points


@pytest.mark.parametrize("lamp", [False, True])
def test_radiance_belongs_to_the_wall_not_to_the_view(room, lamp):
    rng = np.random.default_rng(0)
    points = points_on_walls(rng)
    a, b = np.array([0.1, -0.2, 0.5]), np.array([0.8, 1.1, 1.4])
    # The lamp may hide a point from one place and not from the other.
    for eye in (a, b):
        along = points - eye
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        c = _LAMP_CENTRE - eye
        points = points[np.linalg.norm(c - (along @ c)[:, None] * along, axis=1) > 0.15]
        c = _LAMP_CENTRE - eye
    from_a, from_b = room.radiance(a, points - a, lamp), room.radiance(b, points - b, lamp)
    # Float32 coordinates move a look-up by a hundredth of a texel; at an edge of a window pane that is
    # visible.
    near = np.isclose(from_a, from_b, rtol=0.02, atol=0.02).all(axis=1)
    assert len(points) > 200
    assert near.mean() > 0.98


def test_parallax_is_real(room):
    corner = np.array([UPPER[0], 1.0, 1.2])
    directions = [corner - np.array(eye) for eye in ((0, 0, 0.4), (0.3, 0, 0.4))]
    same_place = [room.radiance(eye, d) for eye, d in zip(((0, 0, 0.4), (0.3, 0, 0.4)), directions, strict=True)]
    np.testing.assert_allclose(*same_place, rtol=1e-3)
    units = [d / np.linalg.norm(d) for d in directions]
    assert np.degrees(np.arccos(units[0] @ units[1])) > 1


def test_each_position_may_have_its_own_ray(room):
    rng = np.random.default_rng(1)
    origins = rng.uniform([-1, -1, 0.1], [1, 1, 1], (50, 3))
    directions = rng.normal(size=(50, 3))
    together = room.radiance(origins, directions, lamp=True)
    alone = [room.radiance(o, d, lamp=True) for o, d in zip(origins, directions, strict=True)]
    np.testing.assert_allclose(together, alone, rtol=1e-5)


def test_shapes_lengths_and_errors(room):
    assert room.radiance(OBJECT, np.ones((2, 3, 4, 3))).shape == (2, 3, 4, 3)
    assert room.radiance(OBJECT, np.zeros((0, 3))).shape == (0, 3)
    d = np.random.default_rng(2).normal(size=(20, 3))
    np.testing.assert_allclose(room.radiance(OBJECT, 7 * d), room.radiance(OBJECT, d), rtol=1e-3)
    axes = np.concatenate([np.eye(3), -np.eye(3)])  # rays along an axis, with zeros of either sign
    assert np.isfinite(room.radiance(OBJECT, axes)).all()
    with pytest.raises(ValueError, match="in the room"):
        room.radiance((9, 0, 0), d)
    with pytest.raises(ValueError, match=r"\(\.\.\., 3\)"):
        room.radiance(OBJECT, np.zeros(4))
    with pytest.raises(ValueError, match="albedo"):
        table_albedo(1.5)


@pytest.mark.parametrize("lamp", [False, True])
def test_light_on_the_table_is_what_its_surroundings_send(room, lamp):
    seen = reference.irradiance(room.truth((0, 0, 0.002), 64, lamp), [0.0, 0.0, 1.0])
    np.testing.assert_allclose(room.irradiance([0.0, 0.0], lamp), seen, rtol=0.03)


@pytest.mark.parametrize("lamp", [False, True])
def test_reflections_add_light_within_reason(room, lamp):
    points = np.random.default_rng(3).uniform([-2.5, -1.9], [3.3, 2.9], (100, 2))
    direct, full = room.irradiance(points, lamp, reflected=False), room.irradiance(points, lamp)
    share = full / direct
    assert (share > 1.02).all()
    assert 1.2 < np.median(share) < 3
    # In a closed room of albedo a, reflections multiply the light by at most about 1 / (1 - a).
    assert room.irradiance([0.0, 0.0], lamp).max() < direct.max() / (1 - 0.8)


def test_lamp_only_adds_light(room):
    d = np.random.default_rng(4).normal(size=(2000, 3))
    assert (room.radiance(OBJECT, d, True) >= room.radiance(OBJECT, d, False) * 0.999).all()
    ratio = room.irradiance([0.0, 0.0], True) / room.irradiance([0.0, 0.0], False)
    assert (ratio > 1.2).all() and (ratio < 3).all()


def test_contrast_is_high(room):
    faces = room.truth(size=64).faces
    assert faces.max() > 100 * np.median(faces)
    assert (faces >= 0).all()


def test_truth_has_the_orientation_of_rays(room):
    truth = room.truth(size=64, lamp=True)
    d = fastibl.texel_directions(64)
    direct = room.radiance(OBJECT, d, True)
    for face in range(6):
        a, b = np.log(truth.faces[face].ravel()), np.log(np.maximum(direct[face].ravel(), 1e-3))
        # A texel's mean and the ray through its middle differ where the room has detail; a turned face would
        # not fit.
        assert np.mean(np.abs(a - b)) < 0.12, face
    brightest = d.reshape(-1, 3)[truth.faces.sum(axis=-1).argmax()]
    towards = (_LAMP_CENTRE - OBJECT) / np.linalg.norm(_LAMP_CENTRE - OBJECT)
    assert np.degrees(np.arccos(brightest @ towards)) < 3.5
    assert np.linalg.norm(_LAMP_CENTRE) > 1.5


def test_truth_is_an_average_over_texels(room):
    coarse, fine = room.truth(size=16, samples=8), room.truth(size=32, samples=4)
    averaged = fine.faces.reshape(6, 16, 2, 16, 2, 3).mean(axis=(2, 4))
    np.testing.assert_allclose(coarse.faces, averaged, rtol=1e-4, atol=1e-4)


def test_below_the_horizon_lies_the_table(room):
    down = room.truth(size=32).faces[5, 8:24, 8:24].mean(axis=(0, 1))
    table = room.albedo * room.irradiance([0.0, 0.0]) / np.pi
    np.testing.assert_allclose(down, table, rtol=0.08)


def test_rectangle_irradiance_against_sums():
    corners = np.array([(-0.3, 0.2, 1.0), (-0.3, 1.1, 1.4), (0.5, 1.1, 1.4), (0.5, 0.2, 1.0)])
    normal = np.cross(corners[1] - corners[0], corners[3] - corners[0])
    area = np.linalg.norm(normal)
    normal /= area
    s = (np.arange(300) + 0.5) / 300
    a, b = np.meshgrid(s, s)
    points = corners[0] + a[..., None] * (corners[1] - corners[0]) + b[..., None] * (corners[3] - corners[0])
    squared = np.sum(points**2, axis=-1)
    kernel = points[..., 2] * np.abs(points @ normal) / squared**2
    up = np.array([0.0, 0.0, 1.0])
    both = [_rectangle_irradiance(np.zeros((1, 3)), up, c)[0] for c in (corners, corners[::-1])]
    assert max(both) == pytest.approx(kernel.mean() * area, rel=1e-4)
    assert min(both) == 0  # seen from behind
    wide = 1e4 * np.array([(-1, -1, 0), (-1, 1, 0), (1, 1, 0), (1, -1, 0)]) + up
    both = [_rectangle_irradiance(np.zeros((1, 3)), up, c)[0] for c in (wide, wide[::-1])]
    assert max(both) == pytest.approx(np.pi, rel=1e-3)


def test_wood_has_the_mean_that_is_asked_for():
    board = wood(0.5, 0.3, 400, (0.5, 0.4, 0.3))
    assert board.shape == (120, 200, 3)
    np.testing.assert_allclose(board.mean(axis=(0, 1)), (0.5, 0.4, 0.3), rtol=1e-4)
    assert board.std() > 0.01 and board.max() < 1
    np.testing.assert_allclose(table_albedo(0.3).mean(), 0.3, rtol=1e-6)
    np.testing.assert_allclose(table_albedo((0.1, 0.2, 0.3)), (0.1, 0.2, 0.3), rtol=1e-6)


@pytest.mark.parametrize("mean", [0.0, 0.5, 0.77, 0.8, 0.95, 1.0])
def test_a_table_of_any_mean(mean):
    albedo = table_albedo(mean)
    assert albedo.mean() == pytest.approx(mean, abs=1e-6) and albedo.min() >= 0 and albedo.max() <= 1
    assert (albedo[0] >= albedo[1] >= albedo[2]) and (albedo[0] > albedo[2] or mean in (0.0, 1.0))
    with pytest.raises(ValueError, match="albedo must be"):
        table_albedo(mean + 1.01)


@pytest.mark.parametrize("size, samples", [(0, 4), (8, 0)])
def test_a_true_map_has_texels_and_samples(room, size, samples):
    with pytest.raises(ValueError, match=f"at least 1, got {size} and {samples}"):
        room.truth(size=size, samples=samples)


def test_rays_along_a_wall_from_on_it(room):
    """A wall that a ray lies in is not met."""
    d = np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0.6, 0.8, 0]])
    on, above = (room.radiance((0, 0, z), d) for z in (0.0, 1e-4))
    np.testing.assert_allclose(on, above, rtol=0.02)
    assert np.isfinite(room.truth((0, 0, 0), 9, samples=1).faces).all()


@pytest.mark.parametrize("mean", [0.3, 0.9, 1.0, (0.2, 0.95, 0.1)])
def test_no_wood_reflects_more_than_it_gets(mean):
    board = wood(0.5, 0.3, 400, table_albedo(mean))
    assert board.max() <= 1 + 1e-6 and board.min() >= 0
    np.testing.assert_allclose(board.mean(axis=(0, 1), dtype=np.float64), table_albedo(mean), rtol=1e-5)
