"""Lights: found where they are, every photon once, steady, and shaded as they shine."""

import numpy as np
import pytest

import fastibl
from conftest import SHARED, units
from fastibl import reference


def discs(places, radius=np.pi / 60, background=0.1, size=128):
    """A map of discs: (direction, radiance)."""
    directions, _, _ = reference.samples(np.zeros((6, size, size, 3)))
    faces = np.full((6 * size * size, 3), background)
    for direction, radiance in places:
        d = np.asarray(direction, float) / np.linalg.norm(direction)
        faces[directions @ d > np.cos(radius)] = radiance
    return fastibl.CubeMap(faces.reshape(6, size, size, 3).astype(np.float32))


def flux(cube):
    _, angles, radiance = reference.samples(cube)
    return angles @ radiance


def assert_every_photon_once(lighting, cube):
    both = flux(lighting._without_lights) + sum((np.array(light.flux) for light in lighting.lights), np.zeros(3))
    error = np.abs(both / np.maximum(flux(cube), 1e-30) - 1).max()
    print(f"flux within {error:.1e}")
    assert error < 1e-5


def angle(a, b):
    return np.degrees(np.arccos(np.clip(np.dot(a, b) / np.linalg.norm(a) / np.linalg.norm(b), -1, 1)))


def test_one_disc():
    place, radiance = np.array([0.3, 0.5, 0.9]), np.array([200.0, 150, 100])
    cube = discs([(place, radiance)])
    lighting = fastibl.Lighting(cube)
    (light,) = lighting.lights
    assert angle(light.direction, place) < 0.1
    assert abs(np.degrees(light.angular_radius) - 3) < 0.2
    facing = reference.irradiance(cube, place / np.linalg.norm(place)) - np.pi * 0.1
    np.testing.assert_allclose(light.irradiance, facing, rtol=0.02)  # the threshold leaves a part in the map
    assert_every_photon_once(lighting, cube)
    assert light == lighting.lights[0] and "angular_radius" in repr(light)


def test_two_opposite_suns():
    place = np.array([0.2, -0.4, 0.8])
    cube = discs([(place, 1000.0), (-place, 500.0)], np.radians(1))
    lights = fastibl.Lighting(cube).lights
    assert len(lights) == 2
    assert angle(lights[0].direction, place) < 0.3 and angle(lights[1].direction, -place) < 0.3
    assert lights[0].irradiance[0] / lights[1].irradiance[0] == pytest.approx(2, rel=0.01)
    assert_every_photon_once(fastibl.Lighting(cube), cube)


def test_nothing_to_find():
    for faces in (np.zeros((6, 16, 16, 3)), np.ones((6, 16, 16, 3)), np.ones((6, 1, 1, 3))):
        assert fastibl.Lighting(fastibl.CubeMap(faces)).lights == []


@pytest.mark.parametrize("size", [1, 3, 32, 100, 128])
def test_one_bright_texel(size):
    faces = np.full((6, size, size, 3), 0.5)
    faces[4, size // 2, size // 3] = 1e6
    cube = fastibl.CubeMap(faces)
    lighting = fastibl.Lighting(cube, glossy="stretched")
    assert_every_photon_once(lighting, cube)
    value = lighting.glossy(units(200), units(200, 1), 30.0)
    assert np.isfinite(value).all() and (value >= 0).all()
    if size >= 32:
        (light,) = lighting.lights
        place = reference.samples(cube)[0].reshape(6, size, size, 3)[4, size // 2, size // 3]
        assert angle(light.direction, place) < 90 / 64  # texels of the working level
        assert sum(light.flux) == pytest.approx(sum(flux(cube)) - 3 * 0.5 * 4 * np.pi, rel=0.01)


def test_real_maps(real_maps):
    for name, cube in real_maps.items():
        lighting = fastibl.Lighting(cube)
        assert len(lighting.lights) <= 8
        assert_every_photon_once(lighting, cube)
        left = lighting._without_lights
        assert (left.faces >= 0).all()
        print(name, len(lighting.lights), "lights hold", 1 - flux(left).sum() / flux(cube).sum())


def irradiance_of(normals, cube, lights=()):
    """Of a map, summed over its texels, and of lights as points."""
    directions, angles, radiance = reference.samples(cube)
    sums = np.maximum(normals @ directions.T, 0) @ (angles[:, None] * radiance)
    return sum((np.maximum(normals @ light.direction, 0)[:, None] * light.irradiance for light in lights), sums)


@pytest.mark.parametrize("size", [16, 64, 100, 128, 256])
def test_what_is_left_and_the_lights_give_what_the_map_gives(size):
    places = [((0.3, 0.5, 0.9), (300.0, 200, 100)), ((-0.8, 0.1, 0.4), (50.0, 80, 90))]
    faces = discs(places, np.radians(2), size=size).faces.copy()
    faces *= np.random.default_rng(0).uniform(0.5, 1.5, faces.shape)  # no two texels of one colour
    cube = fastibl.CubeMap(faces)
    rest, lights = fastibl.without_lights(cube)
    assert rest.size == (size if size >= 64 and size != 100 else 64)
    assert lights == fastibl.Lighting(cube).lights and lights
    both = flux(rest) + sum(np.array(light.flux) for light in lights)
    np.testing.assert_allclose(both, flux(cube), rtol=1e-3 if size == 100 else 1e-6)
    assert rest.faces.max() < 0.06 * faces.max(), "the lamps are still in it"
    same = np.mean(rest.faces == faces) if rest.size == size else 1
    assert same > 0.98, f"{same:.3f} of the map was left as it was"
    normals = units(300)
    off = np.abs(irradiance_of(normals, rest, lights) - irradiance_of(normals, cube))
    off /= irradiance_of(normals, cube).mean()
    print(f"irradiance off by {100 * off.mean():.3f} %, at most {100 * off.max():.2f} % of the mean")
    assert off.mean() < 0.0015 and off.max() < 0.04


def test_where_a_light_was_four_times_the_mean_are_left():
    faces = np.ones((6, 64, 64, 3))
    faces[fastibl.texel_directions(64) @ np.array([0.6, 0, 0.8]) > np.cos(0.08)] = 3000
    cube = fastibl.CubeMap(faces)
    left, lights = fastibl.without_lights(cube)
    assert len(lights) == 1 and left.faces.max() == pytest.approx(4 * np.mean(cube.mean()), rel=1e-3)


def test_what_is_left_of_real_maps(real_maps):
    normals = units(300)
    for name, cube in real_maps.items():
        rest, lights = fastibl.without_lights(cube)
        true = irradiance_of(normals, cube)
        off = np.abs(irradiance_of(normals, rest, lights) - true) / true.mean()
        print(f"{name}: {100 * off.mean():.3f} %, at most {100 * off.max():.2f} % of the mean")
        assert rest.size == cube.size and off.mean() < 0.0015 and off.max() < 0.04


def test_an_even_map_has_nothing_to_take_out():
    cube = fastibl.CubeMap(np.random.default_rng(0).uniform(0.5, 1, (6, 128, 128, 3)))
    rest, lights = fastibl.without_lights(cube)
    assert lights == [] and rest == cube
    with pytest.raises(TypeError, match="CubeMap"):
        fastibl.without_lights(cube.faces)


def test_a_sun_in_the_sky():
    path = SHARED / "hdri-sun" / "immenstadter_horn_1k.hdr"
    if not path.exists():
        pytest.skip(f"{path.name} is not here")
    cube = fastibl.read_environment(path)
    lighting = fastibl.Lighting(cube, glossy="stretched")
    directions, _, radiance = reference.samples(cube)
    brightest = directions[radiance.sum(axis=1).argmax()]
    sun = max(lighting.lights, key=lambda light: sum(light.irradiance))
    assert angle(sun.direction, brightest) < 1.5
    assert_every_photon_once(lighting, cube)
    normals, views = units(60), units(60, 1)
    views *= np.sign((normals * views).sum(axis=1, keepdims=True))
    for s in (8.0, 64.0, 200.0):
        true = reference.glossy(cube, normals, views, s)
        error = np.sqrt(((lighting.glossy(normals, views, s) - true) ** 2).mean(axis=1)) / true.mean()
        print(f"s = {s:g}: {100 * error.mean():.2f} %")
        assert error.mean() < 0.06


def lobe_towards(light_direction, degrees, tilt):
    """A normal and view whose mirror direction lies `degrees` from a light; theta_v = tilt degrees."""
    l = np.asarray(light_direction, float) / np.linalg.norm(light_direction)
    side = np.cross(l, [0.0, 0.6, 0.8])
    side /= np.linalg.norm(side)
    mirror = np.cos(np.radians(degrees)) * l + np.sin(np.radians(degrees)) * side
    across = np.cross(mirror, side)
    n = np.cos(np.radians(tilt)) * mirror + np.sin(np.radians(tilt)) * across
    return n, 2 * (n @ mirror) * n - mirror


@pytest.mark.parametrize("exponent", [2.0, 8.0, 64.0, 2048.0])
@pytest.mark.parametrize("tilt", [0, 45, 80])
def test_highlight_of_a_light(exponent, tilt):
    """Across a highlight, against brute force, relative to its peak."""
    place = [0.4, -0.3, 0.7]
    cube = discs([(place, 300.0)], np.radians(2))
    lighting = fastibl.Lighting(cube, glossy="stretched")
    pairs = [lobe_towards(place, d, tilt) for d in (0, 1, 2, 4, 8, 16, 32)]
    n, v = np.array([p[0] for p in pairs]), np.array([p[1] for p in pairs])
    true = reference.glossy(cube, n, v, exponent)
    error = np.abs(lighting.glossy(n, v, exponent) - true).max() / true.max()
    print(f"s = {exponent:g}, {tilt} degrees: {100 * error:.1f} % of the peak")
    assert error < (0.3 if exponent == 2048 else 0.08)  # at 2048 the map shows it, by three look-ups


def test_light_behind_the_horizon():
    cube = discs([((0, 0, -1), 1000.0)], background=0.01)
    lighting = fastibl.Lighting(cube, glossy="stretched")
    n = np.array([[0, 0, 1.0]])
    for s in (2.0, 16.0, 300.0):
        np.testing.assert_allclose(lighting.glossy(n, n, s), 0.01, rtol=0.15)


def test_steady_under_a_small_change():
    places = [((1, 0.2, 0.3), 100.0), ((-0.5, 0.8, 0.1), 60.0), ((0.9, 0.4, 0.3), 80.0), ((0, -1, 0.5), 40.0)]
    before = fastibl.Lighting(discs(places), glossy="stretched")
    n, v = units(400), units(400, 1)
    v *= np.sign((n * v).sum(axis=1, keepdims=True))
    changed = discs([(places[0][0], 102.0), *places[1:]])
    after = fastibl.Lighting(changed, glossy="stretched", previous=before)
    assert len(after.lights) == len(before.lights)
    for a, b in zip(before.lights, after.lights, strict=True):
        assert angle(a.direction, b.direction) < 0.1
        np.testing.assert_allclose(a.irradiance, b.irradiance, rtol=0.03)
    for s in (4.0, 64.0):
        first, second = before.glossy(n, v, s), after.glossy(n, v, s)
        assert np.abs(second - first).max() <= 0.025 * first.max()


def test_a_light_fades_in():
    """From nothing to a strong light in 40 steps: glossy light never jumps."""
    n, v = np.array([[0, 0, 1.0]]), np.array([[0, 0, 1.0]])
    previous, values = None, []
    for strength in np.linspace(0, 40, 41):
        cube = discs([((0.1, 0, 1), 0.1 + strength), ((1, 0, 0), 60.0)])
        previous = fastibl.Lighting(cube, glossy="stretched", previous=previous)
        values.append(previous.glossy(n, v, 40.0)[0, 0])
    steps = np.diff(values)
    print("steps", steps.min(), "...", steps.max())
    assert (steps > 0).all() and steps.max() < 1.5 * np.median(steps)


def test_a_lamp_switched_on_is_sharp_at_once():
    """What appears in the map pops there, whoever shades it: it need not fade in as a light."""
    n, v = units(400), units(400, 1)
    v *= np.sign((n * v).sum(axis=1, keepdims=True))
    others = [((1, 0.2, 0.3), 30.0), ((-0.5, 0.8, 0.1), 40.0)]
    lit = discs([((0, 0.3, 1), 60.0), *others])
    off = fastibl.Lighting(discs(others))
    on = fastibl.Lighting(lit, previous=off)
    assert len(on.lights) == 3
    np.testing.assert_allclose(on.glossy(n, v, 128.0), fastibl.Lighting(lit).glossy(n, v, 128.0), rtol=1e-3)


def test_a_strong_light_takes_the_place_of_a_weak_one():
    """Of eight lights only the weakest makes room for a new lamp; the others keep their highlights meanwhile."""
    turn = np.arange(9) * np.pi * (3 - np.sqrt(5))
    z = np.linspace(0.9, -0.9, 9)
    places = np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], axis=-1)
    lamps = [(tuple(p), 30.0 + 3 * k) for k, p in enumerate(places)]
    first = fastibl.Lighting(discs(lamps[:8]))

    def by_place(lighting):
        return {k: li for li in lighting.lights for k in range(9) if angle(li.direction, places[k]) < 1}

    before = by_place(first)
    for level, at_once in ((500.0, True), (50.0, False)):
        lighting = first
        for frame in range(40):
            cube = discs([*lamps[:8], (lamps[8][0], level)])  # another map each time
            lighting = fastibl.Lighting(cube, previous=lighting)
            now = by_place(lighting)
            if frame == 0:
                assert (8 in now, 0 in now) == (at_once, not at_once)
            for k in range(1, 8):
                np.testing.assert_allclose(now[k].irradiance, before[k].irradiance, rtol=0.1)
        assert 8 in now and 0 not in now


def test_lights_that_come_to_be_asked_for_fade_in_and_out():
    """A session's plan may take lights out of the map from one frame to the next: their highlights must not pop."""
    n, v = np.array([[0, 0, 1.0]]), np.array([[0, 0, 1.0]])
    level = 40.0
    none, all_ = fastibl.Method("stretched", lights=0), fastibl.Method("stretched")
    previous, values = None, []
    for k in range(90):
        cube = discs([((0.1, 0, 1), level * (1 + 1e-6 * k))])  # another map each time
        method = all_ if 20 <= k < 55 else none
        previous = fastibl.Lighting(cube, glossy=method, previous=previous)
        values.append(previous.glossy(n, v, 400.0)[0, 0])
    values = np.array(values)
    whole = abs(values[50] - values[10])
    steps = np.abs(np.diff(values))
    print(f"without {values[10]:.4f}, with {values[50]:.4f}; largest step {steps.max() / whole:.3f} of the difference")
    assert whole > 0.02 * values[10]  # there is something to fade
    assert steps.max() < 0.06 * whole
    assert abs(values[89] - values[10]) < 1e-4 * values[10]
    # The same map again is no film, and gives at once what was asked for.
    again = fastibl.Lighting(cube, glossy=all_, previous=previous)
    np.testing.assert_allclose(again.glossy(n, v, 400.0), fastibl.Lighting(cube, glossy=all_).glossy(n, v, 400.0))


def test_no_light_is_taken_where_none_is_asked_for_and_another_shines():
    """The lamp that was followed is gone, no light is asked for, and a new lamp is brighter than all."""
    first = fastibl.Lighting(discs([((0, 0, 1), 60.0)]), glossy=fastibl.Method("stretched"))
    cube = discs([((1, 0, 0), 60.0)])
    then = fastibl.Lighting(cube, glossy=fastibl.Method("stretched", lights=0), previous=first)
    n = np.array([[1.0, 0, 0]])
    without = fastibl.Lighting(cube, glossy=fastibl.Method("stretched", lights=0))
    np.testing.assert_array_equal(then.glossy(n, n, 400.0), without.glossy(n, n, 400.0))


def test_the_same_map_gives_the_same_lights(real_maps):
    cube = real_maps["adams_place_bridge"]
    first, second = fastibl.Lighting(cube), fastibl.Lighting(cube)
    assert first.lights == second.lights


@pytest.mark.parametrize("degrees, off", [(0.5, 0.2), (1, 0.06), (2, 0.03)])
def test_a_disc_is_as_wide_as_it_is(degrees, off):
    """Discs that fall into the map as a camera would have them: texels at their rims hold a part of them."""
    size, radius, pieces = 256, np.radians(degrees), 8
    n = size * pieces
    widths = []
    for place in np.random.default_rng(3).normal(size=(4, 3)):
        centre = place / np.linalg.norm(place)
        inside = np.zeros((6, size, size))
        for face in range(6):
            if (fastibl.texel_directions(8)[face] @ centre).max() < np.cos(radius + 0.3):
                continue
            fine = fastibl.texel_directions(n)[face] @ centre > np.cos(radius)
            inside[face] = fine.reshape(size, pieces, size, pieces).mean((1, 3))
        faces = 0.3 + inside[..., None] * np.full(3, 3 / (np.pi * np.sin(radius) ** 2))
        (light,) = fastibl.Lighting(fastibl.CubeMap(faces.astype(np.float32))).lights
        widths.append(light.angular_radius / radius)
    print(f"{degrees} degrees: found by true {np.round(widths, 3)}")
    assert np.abs(np.array(widths) - 1).max() < off


@pytest.mark.parametrize("size", [100, 192, 256, 300, 1000])
def test_a_sun_in_one_texel_is_found_there_in_maps_of_any_size(size):
    """Lights are found in 64 x 64 texels of a face, of which finer ones may be a broken number."""
    faces, place = np.full((6, size, size, 3), 0.5, np.float32), (2, size // 3 + 1, 3 * size // 5)
    faces[place] = 0.25 * 4 * np.pi / fastibl.texel_solid_angles(size)[place[1:]]
    cube = fastibl.CubeMap(faces)
    (light,) = fastibl.Lighting(cube).lights
    towards = fastibl.texel_directions(size)[place]
    off = np.degrees(np.arccos(min(float(np.dot(light.direction, towards)), 1)))
    radius = np.degrees(light.angular_radius)
    print(f"{size}: {off:.3f} degrees off, radius {radius:.3f}")
    level = 90 / min(size, 256 if size % 256 == 0 else size / 2 if size > 256 else size, 250)
    assert off < 0.5 * level + 0.02 and radius < level


@pytest.mark.parametrize("scale", [1e-20, 1e-27, 1e-30])
def test_lights_are_taken_out_of_very_dim_maps(scale):
    rng = np.random.default_rng(0)
    faces = rng.uniform(0.1, 1, (6, 128, 128, 3))
    faces[2, 10:12, 10:12] = 500
    rest, _ = fastibl.without_lights(fastibl.CubeMap(faces * scale))
    plain, _ = fastibl.without_lights(fastibl.CubeMap(faces))
    np.testing.assert_allclose(np.asarray(rest.faces, np.float64) / scale, plain.faces, rtol=1e-4)
