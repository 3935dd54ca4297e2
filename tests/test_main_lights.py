"""Main lights: connected bright regions of a map."""

from __future__ import annotations

import numpy as np
import pytest

import fastibl


def disc_map(discs, size: int = 128, background: float = 0.1):
    """Map with discs of (direction, radius in radians, radiance)."""
    d = fastibl.texel_directions(size).astype(np.float64)
    faces = np.full((6, size, size, 3), background, np.float32)
    for direction, radius, radiance in discs:
        direction = np.asarray(direction, np.float64) / np.linalg.norm(direction)
        faces[d @ direction > np.cos(radius)] = radiance
    return fastibl.CubeMap(faces)


# Middle of a face, across an edge, around a corner.
@pytest.mark.parametrize("direction", [(0, 0, 1), (1, 0.2, 1), (1, 1, 1), (-1, 1, -1), (0.1, -1, -1)])
def test_a_disc_is_one_light_wherever_it_lies(direction):
    direction = np.array(direction) / np.linalg.norm(direction)
    (light,) = fastibl.main_lights(disc_map([(direction, 0.2, (30, 20, 10))]))
    angle = np.degrees(np.arccos(min(1, np.dot(light.direction, direction))))
    true = np.pi * np.sin(0.2) ** 2 * np.array([30, 20, 10])  # of a disc of that radius that is faced
    print(
        f"{angle:.3f} degrees, irradiance {np.abs(light.irradiance / true - 1).max():.4f}, {light.angular_radius:.4f}"
    )
    assert angle < 0.4
    assert np.allclose(light.irradiance, true, rtol=0.03)
    assert light.angular_radius == pytest.approx(0.2, rel=0.07)  # texels that are partly of it count
    ambient = 0.1 * np.pi * np.cos(0.2) ** 2
    assert light.share == pytest.approx(true.mean() / (true.mean() + ambient), rel=0.01)


def test_two_discs_are_two_lights_and_touching_ones_are_one():
    apart = fastibl.main_lights(disc_map([((1, 0, 1), 0.15, 40), ((-1, 0, 1), 0.15, 20)]))
    assert len(apart) == 2 and apart[0].direction[0] > 0  # the brighter first
    touching = fastibl.main_lights(disc_map([((0.1, 0, 1), 0.15, 40), ((-0.1, 0, 1), 0.15, 40)]))
    assert len(touching) == 1


def test_what_gives_little_light_is_none():
    cube = disc_map([((0.3, 0.2, 1), 0.05, 2)])
    assert fastibl.main_lights(cube) == []
    assert len(fastibl.main_lights(cube, least_share=0.01)) == 1


@pytest.mark.parametrize("radiance", [0.0, 1e-8, 1.0, 1e8])
def test_even_maps_have_no_lights(radiance):
    assert fastibl.main_lights(fastibl.CubeMap(np.full((6, 8, 8, 3), radiance, np.float32))) == []


def test_one_texel_of_a_million_and_one_texel_faces():
    faces = np.ones((6, 32, 32, 3), np.float32)
    faces[4, 10, 20] = 1e6
    (light,) = fastibl.main_lights(fastibl.CubeMap(faces))
    assert light.share > 0.99 and np.isfinite(light.irradiance).all()
    single = np.zeros((6, 1, 1, 3), np.float32)
    single[2] = 1
    assert all(np.isfinite(m.share) for m in fastibl.main_lights(fastibl.CubeMap(single), brightness=4))


def test_bad_options_are_refused():
    cube = fastibl.CubeMap(np.ones((6, 4, 4, 3), np.float32))
    for options in ({"brightness": 0}, {"brightness": np.nan}, {"least_share": -1}, {"least_share": np.inf}):
        with pytest.raises(ValueError, match="main light"):
            fastibl.main_lights(cube, **options)
    with pytest.raises(TypeError, match="map must be CubeMap or Environment, got list"):
        fastibl.main_lights([1, 2])


@pytest.mark.parametrize("degrees", [6, 12])
def test_a_lights_solid_angle_is_that_of_its_cap(degrees):
    towards = np.array([0.48, 0.6, 0.64])
    faces = np.where(fastibl.texel_directions(128) @ towards > np.cos(np.radians(degrees)), 100.0, 1.0)
    (light,) = fastibl.main_lights(fastibl.CubeMap(np.repeat(faces[..., None], 3, axis=-1)))
    true = 2 * np.pi * (1 - np.cos(np.radians(degrees)))
    print(f"{light.solid_angle:.4f} sr of {true:.4f}, angular radius {np.degrees(light.angular_radius):.2f} degrees")
    # Of whole texels, which are 1.4 degrees wide.
    assert np.degrees(light.angular_radius) == pytest.approx(degrees, abs=0.5)
    assert light.solid_angle == pytest.approx(true, rel=0.12)
    assert light.solid_angle == pytest.approx(2 * np.pi * (1 - np.cos(light.angular_radius)), rel=1e-3)
