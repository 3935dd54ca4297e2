"""fastibl render: the object's own material, light by the board's white, and the layers of each picture."""

import sys

import numpy as np
import pytest
import trimesh

import fastibl
from fastibl.__main__ import main

av = pytest.importorskip("av")


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("render") / "recording"
    return fastibl.simulate(seconds=0.5, fps=6, size=(320, 240), out=path, lamp=False, hand=False)


def rendered(path, recording, *options):
    """RGB of the last picture, (h, w, 3), and where it is not the back picture's."""
    assert main(["render", str(recording.path), "--out", str(path / "a.webm"), *map(str, options)]) == 0
    with av.open(str(path / "a.webm")) as film:
        last = list(film.decode(video=0))[-1].to_ndarray(format="rgb24").astype(int)
    back = list(recording)[-1].back.astype(int)
    return last, np.abs(last - back).max(-1) > 40


def red_box(path):
    red = trimesh.visual.material.PBRMaterial(
        baseColorFactor=[0.8, 0.02, 0.02, 1.0], metallicFactor=0.0, roughnessFactor=0.8
    )
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    box.visual = trimesh.visual.TextureVisuals(material=red)
    box.export(path)


def test_a_glb_keeps_its_material_unless_another_is_asked_for(tmp_path, recording):
    red_box(tmp_path / "red.glb")
    ratios = []
    for options in ((), ("--diffuse", 0.6)):
        picture, drawn = rendered(tmp_path, recording, "--object", tmp_path / "red.glb", *options)
        red, green, _ = picture[drawn].mean(0)
        ratios.append(red / green)
    print("red / green: its own, grey", ratios)
    assert ratios[0] > 2.5 and ratios[1] < 1.3


def test_without_a_material_the_defaults_that_help_names(tmp_path, recording):
    """An object of no material of its own was matte, and brighter."""
    as_named = rendered(tmp_path, recording, "--diffuse", 0.7, "--glossy", 0.1, "--exponent", 64)[0]
    np.testing.assert_array_equal(rendered(tmp_path, recording)[0], as_named)
    assert (rendered(tmp_path, recording, "--glossy", 0)[0] != as_named).any()


def test_a_painted_mesh_shows_its_colours_unless_it_is_asked_to_be_darker(tmp_path, recording):
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    box.visual.vertex_colors = np.uint8([(230, 40, 40, 255)] * len(box.vertices))
    box.export(tmp_path / "red.ply")
    means = []
    for options in ((), ("--diffuse", 0.4)):
        picture, drawn = rendered(tmp_path, recording, "--object", tmp_path / "red.ply", *options)
        means.append(picture[drawn].mean(0))
    print("its own, darker", means)
    assert means[0][0] > 2 * means[0][1] and means[1][0] > 1.5 * means[1][1] and means[1][0] < 0.9 * means[0][0]


def test_a_given_map_is_as_bright_as_the_boards_white_says(tmp_path, recording, capsys):
    cube = recording.truth.environment(0.0)
    means = []
    for factor in (1, 100):
        fastibl.write_environment(tmp_path / "map.hdr", fastibl.CubeMap(cube.faces * np.float32(factor)))
        picture, drawn = rendered(tmp_path, recording, "--environment", tmp_path / "map.hdr")
        means.append(picture[drawn].mean())
        assert "as the board's white shows it" in capsys.readouterr().out
    print("mean of the object", means)
    assert abs(means[0] - means[1]) <= 2


@pytest.mark.parametrize(
    ("options", "extents"),
    [([], (0.15, 0.15)), (["--height", "0.3"], (0.3, 0.3)), (["--width", "0.3"], (0.3, 0.3)), (["--scale", "0.02"],
                                                                                        (0.04, 0.04))],
)  # fmt: skip
def test_an_objects_size_in_three_ways(options, extents, tmp_path):
    import argparse

    from fastibl.commands._arguments import add_object, object_of

    trimesh.creation.box((2, 2, 2)).export(tmp_path / "box.stl")
    p = argparse.ArgumentParser()
    add_object(p)
    mesh, _ = object_of(p.parse_args(["--object", str(tmp_path / "box.stl"), *options]))
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0)[1:], extents, rtol=1e-5)
    with pytest.raises(SystemExit):
        p.parse_args(["--height", "0.1", "--width", "0.1"])


def test_layers_of_each_picture(tmp_path, recording, capsys):
    pytest.importorskip("OpenEXR")
    rendered(tmp_path, recording, "--layers", tmp_path / "layers")
    files = sorted(p.name for p in (tmp_path / "layers").iterdir())
    assert files == ["00000.exr", "00001.exr", "00002.exr"]
    assert "3 .exr" in capsys.readouterr().out


@pytest.mark.parametrize("missing", ["av", "OpenEXR"])
def test_what_is_not_installed_is_told_before_any_work(tmp_path, recording, monkeypatch, capsys, missing):
    monkeypatch.setitem(sys.modules, missing, None)
    monkeypatch.setattr(fastibl.Session, "__init__", None)  # which takes the time
    out, layers = tmp_path / "a.webm", tmp_path / "layers"
    assert main(["render", str(recording.path), "--out", str(out), "--layers", str(layers)]) == 2
    assert f"pip install {missing}" in capsys.readouterr().err and not out.exists()
