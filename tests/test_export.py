"""Writers of maps and of light for other renderers: values, axes, orientation, the command."""

import builtins
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

import fastibl
from bench.product import readers
from conftest import same_error, units
from fastibl import __main__, dds, ktx2, reference
from fastibl.environment_files import LAYOUTS
from fastibl.pictures import read_picture, write_picture


def exr():
    pytest.importorskip("OpenEXR", reason="pip install OpenEXR")


@pytest.fixture(params=["hdr", "exr"])
def ending(request):
    if request.param == "exr":
        exr()
    return request.param


AXES = ["marker", "gltf", "unity", "godot"]


def gltf(directions):
    """A marker-frame direction in glTF's axes: x stays, up is y, up the board is -z."""
    x, y, z = np.moveaxis(np.asarray(directions), -1, 0)
    return np.stack([x, z, -y], axis=-1)


def in_axes(directions, axes):
    """Unity's importers of glTF reverse x; Godot's axes are glTF's."""
    if axes == "marker":
        return np.asarray(directions)
    return gltf(directions) * ([-1, 1, 1] if axes == "unity" else [1, 1, 1])


def opengl_lookup(faces, direction):
    """Nearest texel of faces (6, n, n, 3), by the table of OpenGL ES 3.0, section 3.8.10."""
    x, y, z = direction
    axis = np.argmax(np.abs(direction))
    face = 2 * axis + (direction[axis] < 0)
    sc, tc = ((-z, -y), (z, -y), (x, z), (x, -z), (x, -y), (-x, -y))[face]
    n, major = faces.shape[1], abs(direction[axis])
    return faces[face, int((tc / major + 1) / 2 * n), int((sc / major + 1) / 2 * n)]


def faces_in_file(path, layout, n):
    if layout == "faces":
        return np.stack(
            [read_picture(path.with_stem(f"{path.stem}_{f}")) for f in ("px", "nx", "py", "ny", "pz", "nz")]
        )
    image = read_picture(path)
    if layout == "strip":
        return image.reshape(6, n, n, 3)
    rows, columns = (1, 1, 0, 2, 1, 1), (2, 0, 1, 1, 1, 3)
    return np.stack([image[r * n : (r + 1) * n, c * n : (c + 1) * n] for r, c in zip(rows, columns, strict=True)])


@pytest.mark.parametrize("axes", AXES)
@pytest.mark.parametrize("layout", ["faces", "strip", "cross"])
def test_faces_lie_where_opengl_looks(marked, tmp_path, ending, layout, axes):
    path = tmp_path / f"m.{ending}"
    names = fastibl.write_environment(path, marked, layout, axes)
    assert all(p.is_file() for p in names) and len(names) == (6 if layout == "faces" else 1)
    faces = faces_in_file(path, layout, 32)
    for d in units(300):
        d = d if np.sort(np.abs(d))[-2] < 0.97 * np.abs(d).max() else np.array([0.3, 0.2, 0.9])
        expected = opengl_lookup(marked.faces, d)
        np.testing.assert_allclose(opengl_lookup(faces, in_axes(d, axes)), expected, atol=expected.max() / 255)
    back = fastibl.read_environment(names[0], axes=axes)
    np.testing.assert_allclose(back.faces, marked.faces, atol=0 if ending == "exr" else 6 / 255)
    if ending == "exr":
        np.testing.assert_array_equal(back.faces, marked.faces)


@pytest.mark.parametrize("layout", ["faces", "strip", "cross"])
@pytest.mark.parametrize("handedness", [None, "left", "right"])
def test_faces_of_either_handedness(marked, tmp_path, layout, handedness):
    """Left-handed ones are looked up at (-x, y, z), as three.js does with what its CubeTextureLoaders read."""
    path = tmp_path / "m.hdr"
    names = fastibl.write_environment(path, marked, layout, "gltf", handedness=handedness)
    faces = faces_in_file(path, layout, 32)
    for d in units(200):
        x, y, z = gltf(d)
        at = (-x, y, z) if handedness == "left" else (x, y, z)
        if np.sort(np.abs(d))[-2] < 0.97 * np.abs(d).max():
            expected = opengl_lookup(marked.faces, d)
            np.testing.assert_allclose(opengl_lookup(faces, at), expected, atol=expected.max() / 255)
    back = fastibl.read_environment(names[0], axes="gltf", handedness=handedness)
    np.testing.assert_allclose(back.faces, marked.faces, atol=6 / 255)


def test_an_equirectangular_picture_has_no_handedness(marked, tmp_path):
    path = tmp_path / "room.hdr"
    write, read = fastibl.write_environment, fastibl.read_environment
    same_error(lambda: write(path, marked, handedness="left"), ValueError, "handedness", "room.hdr", "equirectangular")
    assert not path.exists()
    write(path, marked)
    same_error(lambda: read(path, handedness="right"), ValueError, "handedness", "room.hdr", "equirectangular")
    same_error(lambda: write(path, marked, "strip", handedness="up"), ValueError, "up", "left")
    same_error(lambda: write(path, marked, "strip", handedness=""), ValueError, "''", "left")


def test_faces_are_read_by_the_names_that_three_js_gives_them(marked, tmp_path):
    for made in fastibl.write_environment(tmp_path / "m.hdr", marked, "faces", "gltf", handedness="left"):
        made.rename(made.with_stem(made.stem[2:]))
    back = fastibl.read_environment(tmp_path / "px.hdr", axes="gltf", handedness="left")
    np.testing.assert_allclose(back.faces, marked.faces, atol=6 / 255)
    (tmp_path / "pz.hdr").rename(tmp_path / "posz.hdr")
    same_error(lambda: fastibl.read_environment(tmp_path / "px.hdr"), FileNotFoundError, "pz.hdr")
    same_error(lambda: fastibl.read_environment(tmp_path / "posz.hdr"), ValueError, "posz.hdr", "_px", "px, nx")


@pytest.mark.parametrize("format", ["hdr", "ktx2"])
def test_exported_cubes_are_of_the_handedness_that_was_asked_for(marked, tmp_path, format):
    if format == "hdr":
        read = read_picture
    else:
        from fastibl.ktx2 import read_ktx2

        read = lambda path: read_ktx2(path)[0]  # noqa: E731
    faces = {}
    for handedness in (None, "left", "right"):
        manifest = fastibl.export_light(marked, tmp_path, size=16, levels=2, format=format, handedness=handedness)
        name = manifest["irradiance"]["files"][0]
        faces[handedness] = read(tmp_path / name).reshape(6, 16, 16, 3)
        assert manifest["handedness"] == (handedness or {"hdr": "right", "ktx2": "left"}[format])
    usual, other = ("right", "left") if format == "hdr" else ("left", "right")
    np.testing.assert_array_equal(faces[None], faces[usual])
    # x is mirrored: faces +x and -x change places, and each is seen from the other side.
    np.testing.assert_allclose(faces[other], faces[usual][[1, 0, 2, 3, 4, 5], :, ::-1], rtol=0.01)
    same_error(lambda: fastibl.export_light(marked, tmp_path, handedness="up"), ValueError, "up", "left")


@pytest.mark.parametrize("axes", AXES)
def test_equirect_orientation(marked, tmp_path, ending, axes):
    path = tmp_path / f"m.{ending}"
    assert fastibl.write_environment(path, marked, axes=axes, height=256) == [path]
    image = read_picture(path)
    assert image.shape == (256, 512, 3)
    for d in units(300):
        x, y, z = in_axes(d, axes)
        # three.js' equirectUv, Unity's Skybox/Panoramic, Godot's PanoramaSkyMaterial and the marker frame's own, with
        # row 0 on top.
        u = {
            "gltf": 0.5 + np.arctan2(z, x) / (2 * np.pi),
            "unity": 0.5 - np.arctan2(z, x) / (2 * np.pi),
            "godot": np.arctan2(x, -z) / (2 * np.pi),
            "marker": 0.5 + np.arctan2(x, y) / (2 * np.pi),
        }[axes]
        row, column = int(np.arccos(z if axes == "marker" else y) / np.pi * 256), int((u % 1) * 512)
        around = image[max(row - 12, 0) : row + 13, np.arange(column - 14, column + 15) % 512]
        if np.ptp(around, axis=(0, 1)).max() < 0.01:  # away from edges
            np.testing.assert_allclose(image[row, column], opengl_lookup(marked.faces, d), rtol=0.02)
    back = fastibl.read_environment(path, size=32, axes=axes)
    assert np.abs(back.faces - marked.faces).mean() < 0.1
    sharp = np.median(np.abs(back.faces - marked.faces))
    print(f"median {sharp:.1e}")
    assert sharp < 0.01


def test_equirect_round_trip_keeps_the_picture(tmp_path):
    """The same picture comes back from either axes, to what a quarter turn is."""
    exr()
    cube = fastibl.CubeMap(np.random.default_rng(0).random((6, 32, 32, 3), np.float32))
    fastibl.write_environment(tmp_path / "a.exr", cube)
    fastibl.write_environment(tmp_path / "b.exr", cube, axes="gltf")
    a, b = read_picture(tmp_path / "a.exr"), read_picture(tmp_path / "b.exr")
    assert a.shape == (64, 128, 3)
    np.testing.assert_allclose(np.roll(a, -32, axis=1), b, rtol=1e-4)
    one, two = (fastibl.read_environment(tmp_path / f"{k}.exr", 32, x) for k, x in (("a", "marker"), ("b", "gltf")))
    np.testing.assert_allclose(one.faces, two.faces, rtol=1e-3)


def test_hdr_values(tmp_path):
    """Shared exponents to half a step of the brightest channel, without a bias; black, tiny and huge."""
    image = np.random.default_rng(0).lognormal(sigma=4, size=(40, 30, 3)).astype(np.float32)
    image[0, 0], image[0, 1], image[0, 2], image[0, 3] = 0, 1e-8, 1e8, (1e9, 0, 1e-3)
    image[0, 4] = 255.9  # rounds up to the next exponent
    write_picture(tmp_path / "a.hdr", image)
    back = read_picture(tmp_path / "a.hdr")
    step = np.abs(back - image) / np.maximum(image.max(axis=-1, keepdims=True), 1e-30)
    print(f"largest step {step.max():.5f}, bias {back.sum(dtype=float) / image.sum(dtype=float) - 1:.1e}")
    assert step.max() <= 1 / 256 and (back[0, 0] == 0).all()
    even = np.random.default_rng(1).uniform(1, 2, (200, 200, 3)).astype(np.float32)
    write_picture(tmp_path / "b.hdr", even)
    assert abs(read_picture(tmp_path / "b.hdr").mean() / even.mean() - 1) < 1e-4
    constant = fastibl.CubeMap(np.full((6, 8, 8, 3), 1e-8))
    fastibl.write_environment(tmp_path / "c.hdr", constant, "strip")
    np.testing.assert_allclose(fastibl.read_environment(tmp_path / "c.hdr").faces, 1e-8, rtol=1 / 256)


def test_exr_is_exact(tmp_path):
    exr()
    image = np.random.default_rng(0).lognormal(sigma=9, size=(7, 14, 3)).astype(np.float32)
    image[0, 0] = 0, 1e-38, 1e38
    write_picture(tmp_path / "a.exr", image)
    np.testing.assert_array_equal(read_picture(tmp_path / "a.exr"), image)


def test_odd_and_single_texels(tmp_path):
    for n in (1, 3, 17):
        faces = np.random.default_rng(n).random((6, n, n, 3)).astype(np.float32)
        cube = fastibl.CubeMap(faces)
        for axes in ("marker", "gltf"):
            for layout in ("strip", "cross"):
                fastibl.write_environment(tmp_path / "a.hdr", cube, layout, axes)
                back = fastibl.read_environment(tmp_path / "a.hdr", axes=axes)
                np.testing.assert_allclose(back.faces, faces, atol=1 / 255)


def light_of(folder, manifest, name):
    files = manifest["prefiltered"]["levels"][name]["files"] if isinstance(name, int) else manifest[name]["files"]
    return faces_in_file(folder / files[0], "strip", read_picture(folder / files[0]).shape[1])


def test_export_against_brute_force(marked, tmp_path):
    """What is written, looked up with glTF directions, is the light of the marker frame."""
    manifest = fastibl.export_light(marked, tmp_path, size=32, levels=5)
    assert json.loads((tmp_path / "light.json").read_text()) == manifest
    n = np.array([d for d in units(200) if np.sort(np.abs(d))[-2] < 0.9 * np.abs(d).max()])
    true = reference.irradiance(marked, n)

    irradiance = np.array([opengl_lookup(light_of(tmp_path, manifest, "irradiance"), gltf(d)) for d in n])
    off = np.abs(irradiance - true).mean() / true.mean()
    print(f"irradiance of the nearest of 16^2 texels: {100 * off:.2f} %")
    assert off < 0.03

    x, y, z = gltf(n).T
    sh = np.array(manifest["sh9"]["radiance"])
    basis = np.stack([0.282095 + 0 * x, 0.488603 * y, 0.488603 * z, 0.488603 * x, 1.092548 * x * y, 1.092548 * y * z,
                      0.315392 * (3 * z * z - 1), 1.092548 * x * z, 0.546274 * (x * x - y * y)])  # fmt: skip
    cosine = np.array([np.pi] + [2 * np.pi / 3] * 3 + [np.pi / 4] * 5)
    off = np.abs((basis * cosine[:, None]).T @ sh - true).mean() / true.mean()
    print(f"irradiance of the spherical harmonics: {100 * off:.2f} %")
    assert off < 0.06

    levels = manifest["prefiltered"]["levels"]
    assert [level["size"] for level in levels] == [32, 16, 8, 4, 2]
    assert [level["roughness"] for level in levels] == pytest.approx([0, 0.25, 0.5, 0.75, 1])
    d, angles, radiance = reference.samples(marked)
    for k in (1, 2):
        a = levels[k]["alpha"] ** 2
        faces = light_of(tmp_path, manifest, k)
        made = np.array([opengl_lookup(faces, gltf(v)) for v in n])
        c = np.maximum(n @ d.T, 0)
        weights = (a / ((1 + c) / 2 * (a - 1) + 1)) ** 2 * c * angles
        expected = weights @ radiance / weights.sum(axis=1, keepdims=True)
        off = np.abs(made - expected).mean() / expected.mean()
        print(f"level {k}, nearest of {levels[k]['size']}^2 texels: {100 * off:.2f} %")
        assert off < 0.15  # half a texel away
    np.testing.assert_allclose(light_of(tmp_path, manifest, 0), fastibl.read_environment(
        fastibl.write_environment(tmp_path / "s.hdr", marked, "strip", "gltf")[0]).faces, atol=0)  # fmt: skip


def lamp_and_room(size=128):
    """An environment seen from 7 cm above the board, with a globe of 3 cm that hangs 0.5 m away."""
    centre, lamp, radius = np.array([0, 0, 0.07]), np.array([0.3, -0.2, 0.45]), 0.03
    away = np.linalg.norm(lamp - centre)
    faces = np.full((6, size, size, 3), (0.2, 0.3, 0.4))
    faces[fastibl.texel_directions(size) @ (lamp - centre) / away > np.sqrt(1 - (radius / away) ** 2)] = 200, 150, 100
    return fastibl.Environment(fastibl.CubeMap(faces), centre=centre, lights=[[*lamp, radius]]), centre, lamp


def irradiance_of_picture(path, normals):
    """Of an equirectangular picture as three.js reads it, summed over its pixels."""
    picture = read_picture(path).astype(np.float64)
    height, width = picture.shape[:2]
    v, u = (np.arange(height) + 0.5) / height * np.pi, ((np.arange(width) + 0.5) / width - 0.5) * 2 * np.pi
    y, x, z = np.broadcast_arrays(np.cos(v)[:, None], np.sin(v)[:, None] * np.cos(u), np.sin(v)[:, None] * np.sin(u))
    edges = np.cos(np.linspace(0, np.pi, height + 1))
    light = picture * ((edges[:-1] - edges[1:]) * 2 * np.pi / width)[:, None, None]
    return np.maximum(normals @ np.stack([x, y, z]).reshape(3, -1), 0) @ light.reshape(-1, 3)


def test_lights_apart_and_what_is_left_are_all_of_the_light(tmp_path):
    exr()
    environment, centre, lamp = lamp_and_room()
    n = units(200)
    given = dict(size=32, levels=3, format="exr")
    whole = fastibl.export_light(environment, tmp_path / "whole", **given)
    apart = fastibl.export_light(environment, tmp_path / "apart", **given, lights_apart=True)
    assert whole["lights_in_maps"] and whole["environment_without_lights"] is None
    assert not apart["lights_in_maps"] and apart["lights"] == whole["lights"]
    (light,) = apart["lights"]
    np.testing.assert_allclose(light["direction"], gltf(lamp - centre) / np.linalg.norm(lamp - centre), atol=2e-3)
    np.testing.assert_allclose(light["position"], gltf(lamp), atol=2e-3)
    np.testing.assert_allclose(apart["centre"], gltf(centre), atol=1e-7)

    lamps = np.maximum(n @ light["direction"], 0)[:, None] * light["irradiance"]
    true = irradiance_of_picture(tmp_path / "whole" / "environment.exr", n)
    seen = [read_picture(tmp_path / name / "environment.exr") for name in ("whole", "apart")]
    np.testing.assert_array_equal(*seen)
    rest = irradiance_of_picture(tmp_path / "apart" / apart["environment_without_lights"], n)
    off = np.abs(rest + lamps - true) / true.mean()
    twice = 100 * lamps.mean() / true.mean()
    print(f"{100 * off.mean():.3f} % off, at most {100 * off.max():.2f} %; with the lights twice {twice:.0f} %")
    assert off.mean() < 0.0015 and off.max() < 0.04 and lamps.mean() > 0.2 * true.mean()
    # The other maps are those of what is left, too.
    x, y, z = n.T
    sh = np.stack([0.282095 + 0 * x, *(0.488603 * v for v in (y, z, x))]) * [[np.pi], *3 * [[2 * np.pi / 3]]]
    np.testing.assert_allclose(sh.T @ np.array(apart["sh9"]["radiance"])[:4], rest, rtol=0.02)
    even = light_of(tmp_path / "apart", apart, "irradiance")
    np.testing.assert_allclose([opengl_lookup(even, d) for d in n], rest, rtol=0.02)
    rough = light_of(tmp_path / "apart", apart, 2)
    assert rough.max() < 0.5 < light_of(tmp_path / "whole", whole, 2).max()


@pytest.mark.parametrize("axes", AXES)
@pytest.mark.parametrize("map_axes", AXES)
def test_the_command_keeps_the_picture(tmp_path, axes, map_axes):
    """Turned by whole pixels: its sun stays as small and bright as it was."""
    picture = np.random.default_rng(0).uniform(0.2, 1, (128, 256, 3)).astype(np.float32)
    picture[30, 200] = 5000
    write_picture(tmp_path / "room.hdr", picture)
    out = tmp_path / "light"
    command = ["export", str(tmp_path / "room.hdr"), "--out", str(out), "--size", "16", "--levels", "2"]
    assert __main__.main([*command, "--axes", axes, "--map-axes", map_axes]) == 0
    made = read_picture(out / "environment.hdr")
    assert np.sort(made, axis=None).tolist() == np.sort(read_picture(tmp_path / "room.hdr"), axis=None).tolist()
    cube = fastibl.read_environment(tmp_path / "room.hdr", size=64, axes=map_axes)
    back = fastibl.read_environment(out / "environment.hdr", size=64, axes=axes)
    np.testing.assert_allclose(back.faces, cube.faces, rtol=1e-3, atol=1e-3 * cube.faces.max())


def test_the_command_keeps_the_resolution_where_pixels_cannot(tmp_path):
    """A quarter of this width is no whole number of pixels; KTX 2 holds a cube of as many texels around."""
    write_picture(tmp_path / "room.hdr", np.ones((301, 602, 3), np.float32))
    out = tmp_path / "light"
    command = ["export", str(tmp_path / "room.hdr"), "--out", str(out), "--size", "16", "--levels", "2"]
    assert __main__.main(command) == 0
    assert read_picture(out / "environment.hdr").shape == (512, 1024, 3)
    assert __main__.main([*command, "--format", "ktx2"]) == 0
    assert fastibl.read_environment(out / "environment.ktx2").size == 256


def test_a_given_picture_is_written(tmp_path):
    cube = fastibl.CubeMap(np.ones((6, 16, 16, 3)))
    picture = np.full((8, 16, 3), 2.0)
    picture[0, :3, 0] = np.nan, -1, np.inf
    fastibl.export_light(cube, tmp_path, size=16, levels=2, picture=picture)
    made = read_picture(tmp_path / "environment.hdr")
    assert made.shape == (8, 16, 3) and (made[1:] == 2).all()
    np.testing.assert_allclose(made[0, :3, 0], [0, 0, 1e9], rtol=0.01)
    for wrong, format in ((picture[:7], "hdr"), (picture[..., 0], "hdr"), (picture, "ktx2")):
        same_error(
            lambda p=wrong, f=format: fastibl.export_light(cube, tmp_path, format=f, picture=p),
            ValueError,
            "(h, 2 h, 3)",
        )


@pytest.mark.parametrize("axes", AXES)
def test_light_json_says_the_axes_of_each_file(marked, tmp_path, axes):
    manifest = fastibl.export_light(
        marked, tmp_path, axes=axes, size=32, levels=2, sh=["filament"], gltf=True, usd=True
    )
    said = manifest["axes_of_files"]
    assert set(said) == {p.name for p in tmp_path.iterdir()} - {"light.json"}
    assert said.pop("light.glb") == "gltf" and said.pop("light_dome.hdr") == "dome of light.usda"
    assert said.pop("light.usda") == ("marker" if axes == "marker" else "gltf")
    assert set(said.values()) == {axes}


@pytest.mark.parametrize("format", ["hdr", "ktx2", "dds"])
def test_all_of_an_engine_agrees(tmp_path, format):
    """A lamp, as Unity finds it: its direction, the cubes by that direction, the harmonics by Unity's shader."""
    faces = np.full((6, 32, 32, 3), 0.2, np.float32)
    faces[0, 12:15, 22:25] = (300, 200, 100)
    cube = fastibl.CubeMap(faces)
    manifest = fastibl.export_light(
        cube, tmp_path, axes="unity", size=32, levels=3, mapping="unity", format=format, sh=["filament"]
    )
    assert manifest["handedness"] == "left" and manifest["intensity"] == 1
    (lamp,) = manifest["lights"]
    d = np.array(lamp["direction"])
    np.testing.assert_allclose(d, in_axes(fastibl.Lighting(cube).lights[0].direction, "unity"), atol=1e-6)
    for name, level in ((manifest["irradiance"]["files"][0], 0), (manifest["prefiltered"]["levels"][1]["files"][0], 1)):
        if format == "hdr":
            made = read_picture(tmp_path / name).reshape(6, 16, 16, 3)
        else:
            made = {"ktx2": ktx2.read_ktx2, "dds": dds.read_dds}[format](tmp_path / name)[level]
        assert np.array_equal(opengl_lookup(made, d), made.max(axis=(0, 1, 2))), name
    levels = [level["roughness"] for level in manifest["prefiltered"]["levels"]]
    np.testing.assert_allclose([r * (1.7 - 0.7 * r) for r in levels], [0, 0.5, 1], atol=1e-6)
    # SphericalHarmonicsL2[c, i] is row i; ShadeSH9 of UnityCG.cginc.
    n = units(200)
    x, y, z = n.T
    rows = np.array(json.loads((tmp_path / "sh.json").read_text())["sh"])
    shaded = np.stack([x**0, y, z, x, x * y, y * z, 3 * z * z - 1, z * x, x * x - y * y], axis=-1) @ rows
    true = reference.irradiance(cube, n * [-1, 1, 1] @ [[1, 0, 0], [0, 0, 1], [0, -1, 0]]) / np.pi
    off = np.abs(shaded - true).mean() / true.mean()
    print(f"Unity's harmonics of a lamp and a dim room: {100 * off:.1f} % off")
    assert off < 0.12


@pytest.mark.parametrize("radiance, brightest", [(1e-6, 0), (1.0, 1e7), (2e4, 3e7)], ids=["dim", "sun", "cd/m2"])
@pytest.mark.parametrize("format", ["ktx2", "dds"])
def test_half_floats_hold_all_light(tmp_path, format, radiance, brightest):
    rng = np.random.default_rng(0)
    faces = (radiance * rng.uniform(0.5, 1, (6, 32, 32, 3))).astype(np.float32)
    faces[4, 8, 8] += brightest
    cube = fastibl.CubeMap(faces)
    with pytest.warns(UserWarning, match="intensity of light.json"):
        manifest = fastibl.export_light(cube, tmp_path, size=32, levels=3, format=format)
    assert manifest["intensity"] != 1 and np.log2(manifest["intensity"]) % 1 == 0
    back = fastibl.read_environment(tmp_path / f"environment.{format}", axes="gltf").faces * manifest["intensity"]
    np.testing.assert_allclose(back, cube.faces, rtol=1 / 1000)
    whole = fastibl.Lighting(cube).irradiance_cube(16).faces
    irradiance = fastibl.read_environment(tmp_path / f"irradiance.{format}", axes="gltf").faces * manifest["intensity"]
    np.testing.assert_allclose(irradiance.max(), whole.max(), rtol=0.01)
    if brightest:
        with pytest.warns(UserWarning, match="65504.* lacks 0.*exr") as told:
            fastibl.write_environment(tmp_path / f"alone.{format}", cube)
        assert told[0].filename == __file__
        lost = float(str(told[0].message).split("lacks ")[1].split()[0])
        alone = fastibl.read_environment(tmp_path / f"alone.{format}").faces
        assert lost == pytest.approx(
            1 - (alone.sum(axis=(0, 1, 2)) / faces.sum(axis=(0, 1, 2), dtype=float)).min(), abs=0.01
        )
    same_error(
        lambda: fastibl.export_light(cube, tmp_path, size=16, levels=9, format=format),
        ValueError,
        "5 levels",
        "16",
        "9",
    )


@pytest.mark.parametrize("radiance", [1e-9, 1e-4, 1.0, 1e6])
def test_harmonics_of_dim_and_bright_maps(tmp_path, radiance):
    manifest = fastibl.export_light(
        fastibl.CubeMap(np.full((6, 16, 16, 3), radiance)), tmp_path, size=16, levels=2, sh=["three.js"]
    )
    np.testing.assert_allclose(manifest["sh9"]["radiance"][0], 2 * np.sqrt(np.pi) * radiance, rtol=1e-5)
    probe = json.loads((tmp_path / "probe.json").read_text())["object"]["sh"]
    assert np.ravel(manifest["sh9"]["radiance"]).tolist() == probe


def test_a_map_alone_does_not_know_where_its_lights_are(tmp_path):
    environment, *_ = lamp_and_room(64)
    manifest = fastibl.export_light(environment.radiance, tmp_path, axes="marker", size=16, levels=2)
    assert manifest["centre"] is None and [light["position"] for light in manifest["lights"]] == [None]


def test_the_command_writes_lights_apart(tmp_path, capsys):
    environment, *_ = lamp_and_room(64)
    fastibl.write_environment(tmp_path / "room.hdr", environment)
    command = ["export", str(tmp_path / "room.hdr"), "--out", str(tmp_path / "light"), "--size", "16", "--levels", "2"]
    assert __main__.main(command) == 0 and "also in the maps" in capsys.readouterr().out
    assert __main__.main([*command, "--lights-apart", "--format", "ktx2"]) == 0
    assert "not in the maps" in capsys.readouterr().out
    manifest = json.loads((tmp_path / "light" / "light.json").read_text())
    rest = fastibl.read_environment(tmp_path / "light" / manifest["environment_without_lights"], axes="gltf")
    assert rest.faces.max() < 10 and manifest["lights"]


def test_command(marked, tmp_path, capsys):
    fastibl.write_environment(tmp_path / "room.hdr", marked)
    out = tmp_path / "light"
    assert (
        __main__.main(["export", str(tmp_path / "room.hdr"), "--out", str(out), "--size", "16", "--levels", "3"]) == 0
    )
    assert "light.json" in capsys.readouterr().out
    names = {"light.json", "environment.hdr", "irradiance.hdr", *(f"prefiltered_{k}.hdr" for k in range(3))}
    assert {p.name for p in out.iterdir()} == names
    for wrong in (
        ["none.hdr"],
        [str(tmp_path / "room.hdr"), "--size", "0"],
        [str(tmp_path / "room.hdr"), "--error", "2"],
    ):
        assert __main__.main(["export", *wrong, "--out", str(out)]) == 2
        assert "fastibl: error:" in capsys.readouterr().err
    for stop, code in ((["--help"], 0), (["a.hdr", "--axes", "maya"], 2)):
        with pytest.raises(SystemExit) as caught:
            __main__.main(["export", *stop])
        assert caught.value.code == code
    assert "fastibl export venice" in capsys.readouterr().out


def test_bad_input_is_refused(marked, tmp_path, monkeypatch):
    write = fastibl.write_environment
    same_error(lambda: write(tmp_path / "a.hdr", marked, "dice"), ValueError, "dice", *LAYOUTS)
    same_error(lambda: write(tmp_path / "a.hdr", marked, axes="maya"), ValueError, "maya", "gltf", "unity")
    same_error(lambda: write(tmp_path / "a.png", marked), ValueError, "a.png", ".exr", ".ktx2", ".dds")
    same_error(lambda: fastibl.write_usd(tmp_path / "a.usda", marked, axes="unity"), ValueError, "unity", "marker")
    same_error(lambda: write(tmp_path / "a.hdr", marked, "strip", height=8), ValueError, "height", "strip")
    same_error(lambda: fastibl.read_environment(tmp_path / "none.exr"), FileNotFoundError, "none.exr")
    same_error(lambda: fastibl.export_light(marked, tmp_path, format="png"), ValueError, "png")
    same_error(lambda: fastibl.export_light(marked, tmp_path, mapping="cmft"), ValueError, "cmft")
    same_error(lambda: fastibl.export_light(marked, tmp_path / "g", size=16, gltf=True), ValueError, "32", "got 16")
    cv2.imwrite(str(tmp_path / "odd.hdr"), np.ones((5, 9, 3), np.float32))
    same_error(lambda: fastibl.read_environment(tmp_path / "odd.hdr"), ValueError, "9 x 5")
    real = builtins.__import__

    def without_openexr(name, *rest, **options):
        if name == "OpenEXR":
            raise ImportError(name)
        return real(name, *rest, **options)

    monkeypatch.setattr(builtins, "__import__", without_openexr)
    same_error(lambda: write(tmp_path / "a.exr", marked), ImportError, "pip install OpenEXR")


def test_a_broken_exr_is_refused(tmp_path):
    exr()
    (tmp_path / "broken.exr").write_bytes(b"no picture")
    same_error(lambda: fastibl.read_environment(tmp_path / "broken.exr"), ValueError, "broken.exr")


ROOT = Path(__file__).resolve().parents[1]
THREE_JS = ROOT / "examples" / "three_js"

# What Node finds at directions (in glTF's axes) with the example's own module.
NODE = """
import { readFileSync } from "node:fs";
const { decodeHdr, lookUp, shIrradiance } = await import(process.argv[2]);
const { folder, directions } = JSON.parse(readFileSync(0));
const light = JSON.parse(readFileSync(`${folder}/light.json`));
const strip = (name) => { const b = readFileSync(`${folder}/${name}`); return decodeHdr(b); };
const level = strip(light.prefiltered.levels[1].files[0]), even = strip(light.irradiance.files[0]);
console.log(JSON.stringify(directions.map((d) => [
  shIrradiance(light.sh9.radiance, d), lookUp(even, d), lookUp(level, d)])));
"""


@pytest.fixture(scope="module")
def three_js_scene(marked, tmp_path_factory):
    if not THREE_JS.is_dir():
        pytest.skip("needs the source tree")
    folder = tmp_path_factory.mktemp("three_js")
    fastibl.write_environment(folder / "room.hdr", marked)
    command = [
        sys.executable,
        THREE_JS / "make_scene.py",
        folder / "room.hdr",
        "--out",
        folder / "scene",
        "--size",
        "32",
    ]
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder / "scene"


def test_three_js_scene(three_js_scene):
    names = {p.name for p in three_js_scene.iterdir()}
    assert {"index.html", "scene.js", "light.js", "material.js", "decode.js", "light.json", "figurine.glb"} <= names
    manifest = json.loads((three_js_scene / "light.json").read_text())
    assert all((three_js_scene / level["files"][0]).is_file() for level in manifest["prefiltered"]["levels"])
    figurine = fastibl.read_mesh(three_js_scene / "figurine.glb", up="y")
    np.testing.assert_allclose(np.ptp(figurine.vertices[:, 2]), 0.9, rtol=1e-5)
    for name in ("scene.js", "light.js", "material.js"):
        for line in (three_js_scene / name).read_text().splitlines():
            if line.startswith("import") and "./" in line:
                assert line.split('"./')[1].split('"')[0] in names


def test_three_js_modules_read_what_is_written(three_js_scene, marked, tmp_path):
    node = shutil.which("node")
    if node is None:
        pytest.skip("needs node")
    n = np.array([d for d in units(100) if np.sort(np.abs(d))[-2] < 0.9 * np.abs(d).max()])
    (tmp_path / "check.mjs").write_text(NODE)
    given = json.dumps({"folder": str(three_js_scene), "directions": gltf(n).tolist()})
    module = tmp_path / "decode.mjs"
    module.write_text((three_js_scene / "decode.js").read_text())
    command = [node, str(tmp_path / "check.mjs"), str(module)]
    done = subprocess.run(command, input=given, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    sh, even, level = np.moveaxis(np.array(json.loads(done.stdout)), 1, 0)
    map_read = fastibl.read_environment(three_js_scene / "environment.hdr", size=32, axes="gltf")
    true = reference.irradiance(map_read, n)
    for name, made, allowed in (("harmonics", sh, 0.06), ("irradiance", even, 0.03)):
        off = np.abs(made - true).mean() / true.mean()
        print(f"{name} in Node: {100 * off:.2f} %")
        assert off < allowed
    expected = fastibl.Lighting(map_read).prefiltered(32)[1].sample(n)
    assert np.abs(level - expected).mean() / expected.mean() < 0.1  # nearest texels


# A page that draws the example's own shader under white light, one pixel for each case, without three.js.
FURNACE = """
<!doctype html><body><script type="module">
const THREE = { ShaderMaterial: class { constructor(given) { Object.assign(this, given); } }, Color: class {} };
MATERIAL
const { table, cases } = GIVEN;
const shading = litMaterial({}).fragmentShader;
const gl = document.createElement("canvas").getContext("webgl2");
gl.getExtension("EXT_color_buffer_float");
const program = gl.createProgram();
for (const [kind, text] of [[gl.VERTEX_SHADER, `#version 300 es
  uniform vec3 view; out vec3 v_normal, v_position;
  void main() { v_normal = vec3(0, 0, 1); v_position = -view; gl_Position = vec4(0, 0, 0, 1); gl_PointSize = 1.0; }`],
  [gl.FRAGMENT_SHADER, `#version 300 es
  precision highp float; precision highp samplerCube;
  #define varying in
  #define texture2D texture
  #define gl_FragColor colour
  uniform vec3 cameraPosition; out vec4 colour;` + shading.replaceAll(/#include.*/g, "")]]) {
  const shader = gl.createShader(kind);
  gl.shaderSource(shader, text);
  gl.compileShader(shader);
  if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) document.title = gl.getShaderInfoLog(shader);
  gl.attachShader(program, shader);
}
gl.linkProgram(program);
gl.useProgram(program);
const at = (name) => gl.getUniformLocation(program, name);
gl.activeTexture(gl.TEXTURE0);
gl.bindTexture(gl.TEXTURE_CUBE_MAP, gl.createTexture());
for (let f = 0; f < 6; ++f) {
  gl.texImage2D(gl.TEXTURE_CUBE_MAP_POSITIVE_X + f, 0, gl.RGBA, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE,
    new Uint8Array([255, 255, 255, 255]));
}
gl.activeTexture(gl.TEXTURE1);
gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
gl.texImage2D(gl.TEXTURE_2D, 0, gl.RG16F, table[0].length, table.length, 0, gl.RG, gl.FLOAT,
  new Float32Array(table.flat(2)));
gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
gl.uniform1i(at("prefiltered"), 0);
gl.uniform1i(at("ggx_albedo"), 1);
const sh = new Float32Array(27).fill(Math.sqrt(4 * Math.PI), 0, 3);
gl.uniform3fv(at("sh"), sh);
const target = gl.createRenderbuffer();
gl.bindRenderbuffer(gl.RENDERBUFFER, target);
gl.renderbufferStorage(gl.RENDERBUFFER, gl.RGBA32F, 1, 1);
gl.bindFramebuffer(gl.FRAMEBUFFER, gl.createFramebuffer());
gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.RENDERBUFFER, target);
gl.viewport(0, 0, 1, 1);
const out = cases.map(({ cosine, roughness, metallic, color }) => {
  gl.uniform3f(at("view"), Math.sqrt(1 - cosine * cosine), 0, cosine);
  gl.uniform1f(at("roughness"), roughness);
  gl.uniform1f(at("metallic"), metallic);
  gl.uniform3fv(at("base_color"), color);
  gl.drawArrays(gl.POINTS, 0, 1);
  const pixel = new Float32Array(4);
  gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.FLOAT, pixel);
  return [...pixel.slice(0, 3)];
});
document.body.textContent = `RESULT${JSON.stringify(out)}END ${document.title}`;
</script></body>
"""


def test_the_example_keeps_white_white(three_js_scene, tmp_path):
    """Its material in a white furnace, against the library's albedo with light that is scattered more than once."""
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("needs chromium")
    table = three_js_scene / "ggx_albedo.json"
    cases = [
        dict(cosine=cosine, roughness=roughness, metallic=metallic, color=color)
        for cosine in (0.1, 0.5, 1.0)
        for roughness in (0.0, 0.1, 0.25, 0.5, 0.75, 1.0)
        for metallic, color in ((1, (1, 1, 1)), (1, (1, 0.7, 0.3)), (0, (1, 1, 1)), (0, (0.2, 0.5, 0.8)))
    ]
    given = {"table": json.loads(table.read_text()) if table.exists() else [[[0, 0]]], "cases": cases}
    material = (three_js_scene / "material.js").read_text().replace('import * as THREE from "three";', "")
    page = FURNACE.replace("MATERIAL", material.replace("export function", "function"))
    (tmp_path / "page.html").write_text(page.replace("GIVEN", json.dumps(given)))
    command = [chromium, *readers._CHROMIUM, f"--user-data-dir={tmp_path}/profile", f"file://{tmp_path}/page.html"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    found = re.search(r"RESULT(\[.*\])END", done.stdout)
    assert found, done.stdout + done.stderr[-2000:]

    def reflectance(f0, a, b):
        return (f0 * a + b) * (1 + f0 * (1 / (a + b) - 1))

    worst = 0.0
    for case, colour in zip(cases, json.loads(found[1]), strict=True):
        view = np.array([np.sqrt(1 - case["cosine"] ** 2), 0, case["cosine"]])
        a, b = fastibl.ggx_albedo(view, case["roughness"])
        plain, base = reflectance(0.04, a, b), np.array(case["color"])
        true = reflectance(base, a, b) if case["metallic"] else plain + (1 - plain) * base
        off = np.abs(colour - true).max()
        assert off < (1e-5 if case["color"] == (1, 1, 1) else 0.004), (case, colour, true)
        worst = max(worst, off)
    print(f"at most {worst:.4f} off")


@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize("height", [None, 8, 64])
def test_a_small_sun_keeps_its_light_in_an_equirectangular_picture(axis, height, tmp_path):
    """At the poles, too, where rows of a picture hold little of the sphere."""
    faces = np.zeros((6, 32, 32, 3), np.float32)
    faces[axis, 16, 16] = 1000.0
    cube = fastibl.CubeMap(faces)
    true = float((faces[..., 0] * fastibl.texel_solid_angles(32)).sum())
    fastibl.write_environment(tmp_path / "sun.hdr", cube, height=height)
    fastibl.write_usd(tmp_path / "sun.usda", cube, height=height)
    for name in ("sun.hdr", "sun_dome.hdr"):
        picture = fastibl.pictures.read_picture(tmp_path / name)
        edges = np.cos(np.linspace(0, np.pi, len(picture) + 1))
        angles = (edges[:-1] - edges[1:]) * 2 * np.pi / picture.shape[1]
        flux = float((picture[..., 0] * angles[:, None]).sum())
        assert flux == pytest.approx(true, rel=0.004), f"{name}: {flux / true:.4f}"  # shared exponents


def test_a_folder_that_is_not_there_is_named_and_no_other_file(tmp_path):
    path = tmp_path / "nowhere" / "map.hdr"
    with pytest.raises(FileNotFoundError) as error:
        fastibl.write_environment(path, fastibl.CubeMap(np.ones((6, 4, 4, 3), np.float32)))
    assert error.value.filename == str(path)


def test_what_cannot_be_exported_is_said_before_any_work(tmp_path, monkeypatch):
    cube = fastibl.CubeMap(np.ones((6, 8, 8, 3), np.float32))
    monkeypatch.setattr(fastibl.Lighting, "prefiltered", None)
    for options, told in (
        ({"layout": "spiral"}, "layout must be"),
        ({"picture": np.zeros((0, 0, 3))}, "picture must be"),
    ):
        with pytest.raises(ValueError, match=told):
            fastibl.export_light(cube, tmp_path / "out", **options)
        assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("options, told", [({"size": 100_000}, "1 to 8192"), ({"wanted": [0.5]}, "whole number")])
def test_levels_that_cannot_be_made(options, told):
    lighting = fastibl.Lighting(fastibl.CubeMap(np.ones((6, 8, 8, 3), np.float32)))
    with pytest.raises((TypeError, ValueError), match=told):
        lighting.prefiltered(**options)
