"""Maps that follow pictures: what changed is renewed, and the result is what a full rebuild gives."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import fastibl
from views import camera_of, exposed, looking, picture_of

CENTRE = (0.0, 0.0, 0.05)


def place(directions):
    x, y, z = np.moveaxis(np.asarray(directions, np.float64), -1, 0)
    light = 0.3 + 0.2 * np.sin(5 * x + 3 * y) * np.cos(4 * z) + 0.1 * np.sin(9 * y)
    light[x > 0.97] = 4.0  # clips
    return np.stack([light, 0.8 * light, 0.5 + 0.3 * z], axis=-1)


def views(count, seed):
    """Random cameras above and below the horizon, of two lenses, with masks, exposures and a jump of the light."""
    rng = np.random.default_rng(seed)
    for k in range(count):
        towards = rng.normal(size=3)
        camera = camera_of(160, 120, 70.0, distortion=(-0.1, 0.01, 0, 0)) if k % 3 else camera_of(160, 120, 60.0)
        pose = looking(towards, eye=(*(0.2 * rng.normal(size=2)), 0.3))
        exposure = float(rng.choice([0.25, 1.0, 2.0]))
        light = picture_of(place, camera, pose) * (1.5 if 20 < k < 30 else 1.0)
        mask = rng.random((120, 160)) < 0.9 if k % 5 == 0 else None
        yield exposed(np.nan_to_num(light), camera, exposure), camera, pose, exposure, 0.05 * k, mask


def run(size, count, seed, each=True, hold=0, **options):
    """A capture of `count` views; environments asked for after each, the last `hold` of them kept."""
    capture, held = fastibl.Capture(size=size, centre=CENTRE, **options), []
    for image, camera, pose, exposure, time, mask in views(count, seed):
        capture.add(image, camera, pose, exposure=exposure, time=time, mask=mask)
        if each:
            held = [*held, capture.environment()][-hold:] if hold else [capture.environment()]
    return capture, held


def relative(a, b):
    return np.abs(np.asarray(a, np.float64) - b).max() / max(np.abs(b).max(), 1e-30)


def assert_is_rebuilt(env, what):
    """The map is what a map made anew of its faces is: all levels, SH sums and irradiance."""
    anew = fastibl.CubeMap(np.array(env.radiance.faces))
    off = [relative(env.radiance.level(k), anew.level(k)) for k in range(anew.level_count)]
    normals = np.random.default_rng(0).normal(size=(200, 3))
    for method in ("sh9", "irradiance-cube"):
        ours = fastibl.Lighting(env, diffuse=method).irradiance(normals)
        off.append(relative(ours, fastibl.Lighting(anew, diffuse=method).irradiance(normals)))
    edges = np.random.default_rng(1).normal(size=(2000, 3))
    edges[:, 0] = edges[:, 1] * np.where(edges[:, 2] > 0, 1, -1)  # on edges of faces: the borders
    for level in (0.0, 1.5, 3.0):
        off.append(relative(env.radiance.sample(edges, level), anew.sample(edges, level)))
    worst = np.max(off)
    print(f"{what}: incremental against rebuilt {worst:.1e}")
    assert worst <= 1e-5
    assert env.radiance == anew


@pytest.mark.parametrize("size", [1, 3, 7, 16, 33, 64, 100, 256])
def test_updated_levels_are_rebuilt_levels(size):
    capture = fastibl.Capture(size=size, centre=CENTRE)
    env = None
    for k, (image, camera, pose, exposure, time, mask) in enumerate(views(24, size)):
        capture.add(image, camera, pose, exposure=exposure, time=time, mask=mask)
        env = capture.environment()
        if k % 8 == 7:
            assert_is_rebuilt(env, f"{size} after {k + 1}")


def test_a_long_sequence_does_not_drift():
    _, (env,) = run(64, 400, 5)
    assert_is_rebuilt(env, "64 after 400 pictures")


def test_when_a_map_is_asked_for_does_not_matter():
    """Asked for after each picture, with others still held, or once at the end: the same bits."""
    maps = []
    for options in ({"each": True}, {"each": True, "hold": 5}, {"each": False}):
        capture, _ = run(64, 40, 7, **options)
        env = capture.environment()
        maps.append(
            (
                env.radiance.faces.tobytes(),
                env.radiance.level(3).tobytes(),
                env.confidence.tobytes(),
                env.age.tobytes(),
                env.coverage,
                env.clipped,
                env.predicted_error,
            )
        )
    assert maps[0] == maps[1] == maps[2]


def test_a_map_that_is_held_does_not_change():
    capture = fastibl.Capture(size=32, centre=CENTRE)
    held = []
    for image, camera, pose, exposure, time, mask in views(12, 3):
        capture.add(image, camera, pose, exposure=exposure, time=time, mask=mask)
        env = capture.environment()
        held.append((env, env.radiance.faces.copy(), env.age, env.coverage))
        view = capture.environment().radiance.faces  # keeps its map alive by itself
        held.append((view, view.copy(), None, None))
    for env, faces, age, coverage in held:
        now = env if age is None else env.radiance.faces
        np.testing.assert_array_equal(now, faces)
        if age is not None:
            np.testing.assert_array_equal(env.age, age)
            assert env.coverage == coverage
    lighting = fastibl.Lighting(capture.environment())
    before = lighting.irradiance(np.eye(3))
    for image, camera, pose, exposure, time, mask in views(3, 4):
        capture.add(image, camera, pose, exposure=exposure, time=10 + time, mask=mask)
        capture.environment()
    np.testing.assert_array_equal(lighting.irradiance(np.eye(3)), before)
    np.testing.assert_array_equal(lighting.glossy(np.eye(3), np.eye(3), 64), lighting.glossy(np.eye(3), np.eye(3), 64))


@pytest.mark.parametrize("size", [7, 64])
def test_versions_tell_what_changed(size):
    """Tiles of one version hold the same texels; most keep theirs when a picture shows a part of the place."""
    capture, tiles = fastibl.Capture(size=size, centre=CENTRE), min(size, 16)
    edges = np.arange(tiles + 1) * size // tiles
    seen, kept = {}, []
    for image, camera, pose, exposure, time, _ in views(30, 11):
        before = capture.environment().radiance.tile_versions.copy()
        capture.add(image, camera, pose, exposure=exposure, time=time)
        cube = capture.environment().radiance
        assert cube.tile_versions.shape == (6, tiles, tiles)
        kept.append((cube.tile_versions == before).mean())
        for face, y, x in np.ndindex(6, tiles, tiles):
            texels = cube.faces[face, edges[y] : edges[y + 1], edges[x] : edges[x + 1]].tobytes()
            key = (int(cube.tile_versions[face, y, x]), face, y, x)
            assert seen.setdefault(key, texels) == texels
    print(f"{size}: tiles that keep their version, by picture: {np.round(kept, 2)}")
    assert np.median(kept[15:]) > 0.5
    a, b = fastibl.CubeMap(np.ones((6, 8, 8, 3))), fastibl.CubeMap(np.ones((6, 8, 8, 3)))
    assert a == b and not (a.tile_versions == b.tile_versions).any()


def test_the_same_picture_again_changes_only_its_tiles():
    camera, pose = camera_of(160, 120, 60.0), looking((0.3, 1, 0.8), eye=(0, -0.2, 0.3))
    capture = fastibl.Capture(size=128, centre=CENTRE)
    picture = exposed(picture_of(place, camera, pose), camera)
    capture.add(picture, camera, pose, time=0.0)
    before = capture.environment().radiance.tile_versions.copy()
    capture.add(picture, camera, pose, time=0.1)
    changed = capture.environment().radiance.tile_versions != before
    coverage = capture.environment().coverage
    print(f"the picture covers {100 * coverage:.0f} % of the sphere, {100 * changed.mean():.0f} % of the tiles changed")
    assert 0 < changed.mean() < 2 * coverage + 0.05


@pytest.mark.filterwarnings("ignore:back_from_marker shows neither")
def test_sessions_follow_what_a_new_session_would_have():
    """After many pictures levels and irradiance are those of the map made anew, and replay gives the same bits."""
    rig = fastibl.Rig(camera_of(160, 120, 70.0))
    scene = fastibl.Scene(fastibl.shapes.figurine(0.1), spheres=4, visibility_rays=0)
    results = []
    for _ in range(2):
        session = fastibl.Session(scene, rig, size=64, methods={"diffuse": "sh9"})
        for image, _, pose, exposure, time, _ in views(15, 9):
            result = session.process(
                fastibl.Frame(time, back=image[:120, :160], back_exposure=exposure, back_from_marker=pose)
            )
        assert_is_rebuilt(result.environment, "session")
        normals = np.random.default_rng(0).normal(size=(50, 3))
        anew = fastibl.Lighting(fastibl.CubeMap(np.array(result.environment.radiance.faces)), diffuse="sh9")
        assert relative(result.lighting.irradiance(normals), anew.irradiance(normals)) <= 1e-5
        results.append((result.image.tobytes(), result.environment.radiance.faces.tobytes()))
    assert results[0] == results[1]


def digest(threads):
    fastibl.set_threads(threads)
    capture, _ = run(64, 20, 13)
    env = capture.environment()
    parts = (env.radiance.faces, env.radiance.level(2), env.confidence, env.age)
    return hashlib.sha256(b"".join(np.ascontiguousarray(p).tobytes() for p in parts)).hexdigest()


def test_replay_gives_the_same_bits():
    """In fresh processes, with one thread and with two."""
    code = "import sys; sys.path.insert(0, 'tests'); import test_incremental as t; print(t.digest(int(sys.argv[1])))"
    root = Path(__file__).parents[1]
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(root / "tests"), *sys.path])}
    found = {
        subprocess.run(
            [sys.executable, "-c", code, str(n)], cwd=root, env=env, check=True, capture_output=True, text=True
        ).stdout
        for n in (1, 2, 1)
    }
    assert len(found) == 1


@pytest.mark.parametrize("size", [1, 2, 3, 5, 17, 48])
def test_area_exact_conversion_of_any_size(size):
    """Energy is kept to 1e-6 a channel, and texels are near the mean of a picture cut into small pieces."""
    rng = np.random.default_rng(size)
    for height, width in ((1, 1), (1, 2), (3, 5), (32, 64), (40, 100)):
        image = rng.random((height, width, 3)).astype(np.float32)
        cube = fastibl.cubemap_from_equirect(image, size=size)
        rows = np.cos(np.arange(height + 1) / height * np.pi)
        weights = (rows[:-1] - rows[1:]) / 2 / width
        want = (image.astype(np.float64) * weights[:, None, None]).sum(axis=(0, 1))
        np.testing.assert_allclose(cube.mean(), want, rtol=1e-6)
    constant = fastibl.cubemap_from_equirect(np.full((24, 48, 3), 0.7, np.float32), size=size)
    np.testing.assert_allclose(constant.faces, 0.7, rtol=1e-6)


def test_area_exact_conversion_is_the_mean_of_each_texel():
    """Against 64 x 64 directions in every texel."""
    image, size, split = np.random.default_rng(1).random((16, 32, 3)).astype(np.float32), 8, 64
    fine = fastibl.texel_directions(size * split).astype(np.float64)
    u = (0.5 + np.arctan2(fine[..., 0], fine[..., 1]) / (2 * np.pi)) * 32
    v = np.arccos(np.clip(fine[..., 2], -1, 1)) / np.pi * 16
    values = (
        image[np.clip(v.astype(int), 0, 15), u.astype(int) % 32]
        * fastibl.texel_solid_angles(size * split)[None, ..., None]
    )
    truth = (
        values.reshape(6, size, split, size, split, 3).sum(axis=(2, 4))
        / fastibl.texel_solid_angles(size)[None, ..., None]
    )
    error = np.abs(fastibl.cubemap_from_equirect(image, size=size).faces - truth)
    print(f"area-exact: mean error {error.mean() / truth.mean():.1e}, worst {error.max() / truth.mean():.1e}")
    assert error.mean() < 1.5e-3 * truth.mean() and error.max() < 2e-2 * truth.mean()


def test_point_conversion_is_a_bilinear_look_up():
    image, size = np.random.default_rng(2).random((20, 40, 3)).astype(np.float32), 9
    d = fastibl.texel_directions(size).astype(np.float64)
    u = (0.5 + np.arctan2(d[..., 0], d[..., 1]) / (2 * np.pi)) * 40 - 0.5
    v = np.clip(np.arccos(np.clip(d[..., 2], -1, 1)) / np.pi * 20 - 0.5, 0, 19)
    x, y = np.floor(u).astype(int), np.minimum(v.astype(int), 18)
    fx, fy = (u - x)[..., None], (v - y)[..., None]
    top = image[y, x % 40] * (1 - fx) + image[y, (x + 1) % 40] * fx
    low = image[y + 1, x % 40] * (1 - fx) + image[y + 1, (x + 1) % 40] * fx
    expected = top * (1 - fy) + low * fy
    cube = fastibl.cubemap_from_equirect(image, size=size, filter="point")
    np.testing.assert_allclose(cube.faces, expected, atol=2e-4)
    for shape in ((1, 1), (1, 3), (2, 1)):
        one = fastibl.cubemap_from_equirect(np.full((*shape, 3), 0.3, np.float32), size=3, filter="point")
        np.testing.assert_allclose(one.faces, 0.3, rtol=1e-6)
    with pytest.raises(ValueError, match="nearest"):
        fastibl.cubemap_from_equirect(image, size=4, filter="nearest")


def test_bad_pixels_of_a_panorama_are_cleaned():
    image = np.ones((16, 32, 3), np.float32)
    image[3, 4], image[5, 6], image[7, 8] = np.nan, -5, np.inf
    for kind in ("area", "point"):
        faces = fastibl.cubemap_from_equirect(image, size=16, filter=kind).faces
        assert np.isfinite(faces).all() and (faces >= 0).all() and (faces <= 1e9).all()


def test_large_maps():
    cube = fastibl.CubeMap(np.random.default_rng(0).random((6, 1024, 1024, 3), np.float32))
    assert cube.level_count == 11
    np.testing.assert_allclose(np.mean(cube.level(10), axis=(0, 1, 2)), cube.mean(), rtol=1e-4)
    camera, pose = camera_of(320, 240, 70.0), looking((0, 1, 1))
    capture = fastibl.Capture(size=1024)
    capture.add(np.full((240, 320, 3), 0.5), camera, pose)
    env = capture.environment()
    assert np.isfinite(env.radiance.faces).all() and 0.05 < env.coverage < 0.15


@pytest.mark.filterwarnings("ignore:back_from_marker shows neither")
@pytest.mark.parametrize("half", ["0", "1"])
def test_textures_follow_the_map(half, monkeypatch):
    """A GL session that uploads what changed draws what a new one draws that uploads all."""
    monkeypatch.setenv("FASTIBL_GL_HALF", half)
    material = fastibl.Material(diffuse=(0.3, 0.3, 0.3), glossy=(0.7, 0.7, 0.7), exponent=200.0)
    scene = fastibl.Scene(fastibl.shapes.figurine(0.1), material, spheres=4, visibility_rays=0)
    rig, still = fastibl.Rig(camera_of(160, 120, 50.0)), looking((0, 0.25, -0.15), eye=(0, -0.25, 0.2))
    # Lights and the directions of shadows stay from frame to frame, and so depend on the film.
    methods = {"shadow": "cap-product", "glossy": fastibl.Method("centroid", lights=0)}
    try:
        session = fastibl.Session(scene, rig, size=64, backend="gl", methods=methods)
    except RuntimeError as error:
        pytest.skip(str(error))
    for k, (image, _, pose, exposure, time, _) in enumerate(views(8, 15)):
        pose = still if k % 2 else pose
        result = session.process(fastibl.Frame(time, back=image, back_exposure=exposure, back_from_marker=pose))
        faces = np.array(result.environment.radiance.faces)
        fresh = fastibl.Session(scene, rig, environment=fastibl.CubeMap(faces), backend="gl", methods=methods)
        expected = fresh.process(fastibl.Frame(0.0, back=image, back_exposure=exposure, back_from_marker=pose)).image
        np.testing.assert_array_equal(result.image, expected)
