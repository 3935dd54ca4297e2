"""What fuzz targets, properties and extreme cases found, each with a test of its own."""

import numpy as np
import pytest

import fastibl
from conftest import same_error
from fastibl.extremes.views import camera_of, looking
from fastibl.extremes.worlds import box_mesh
from fastibl.recording import read_board, read_rig, write_board, write_rig


@pytest.mark.parametrize("size", [1e-30, 1e-12, 1.0, 1e12, 1e30])
def test_normals_and_tangents_of_any_size(size):
    vertices, triangles = box_mesh()
    mesh = fastibl.Mesh(vertices * size, triangles, uvs=vertices[:, :2] * 10)
    usual = fastibl.Mesh(vertices, triangles, uvs=vertices[:, :2] * 10)
    np.testing.assert_allclose(mesh.normals, usual.normals, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(mesh.tangents[:, :3], axis=1), 1, atol=1e-5)


def test_given_normals_of_any_length():
    normals = np.array([(0, 0, 1e-30), (0, 1e30, 0), (0, 0, 0)])
    mesh = fastibl.Mesh(np.eye(3), [(0, 1, 2)], normals=normals)
    np.testing.assert_allclose(mesh.normals, [(0, 0, 1), (0, 1, 0), (0, 0, 1)], atol=1e-6)


def test_a_mesh_without_extent_exchanges_nothing():
    exchange = fastibl.PlaneExchange(fastibl.Mesh(np.full((3, 3), 0.02), [(0, 1, 2)]), cells=4)
    assert (exchange.onto_plane(np.ones((3, 3))) == 0).all() and (exchange.onto_object(np.ones((4, 4, 3))) == 0).all()


def test_cameras_that_no_lens_is():
    same_error(lambda: fastibl.Camera(10, 10, 1e300, 1e300, 5, 5), ValueError, "focal", "1e+300")
    same_error(lambda: fastibl.Camera(10, 10, 1e-9, 1e-9, 5, 5), ValueError, "focal", "1e-09")
    same_error(lambda: fastibl.Camera(10, 10, 9, 9, 1e9, 5), ValueError, "principal")
    same_error(lambda: fastibl.Camera(100000, 10, 9, 9, 5, 5), ValueError, "16384")
    same_error(lambda: fastibl.Camera(10, 10, 9, 9, 5, 5, [1e30, 0, 0, 0]), ValueError, "distortion")


def test_projections_are_finite_or_nan():
    fisheye = fastibl.Camera(64, 64, 20, 20, 32, 32, model="fisheye")
    perspective = fastibl.Camera(64, 64, 20, 20, 32, 32, [1e9, 0, 0, 0])
    points = np.array([(np.inf, 0, 1), (np.inf, np.inf, np.inf), (1e300, 0, 1e-8), (np.nan, 0, 1)])
    for camera in (fisheye, perspective):
        assert not np.isinf(camera.project(points)).any()
        assert not np.isinf(camera.unproject(np.array([(np.inf, 0), (1e308, -1e308)]))).any()


def test_decoding_nan_gives_0():
    for response in (fastibl.Response.srgb(), fastibl.Response.gamma(2.2)):
        assert response.decode(np.array([np.nan]))[0] == 0


def test_a_black_sky_does_not_darken_the_plane():
    capture, camera = fastibl.Capture(size=1), fastibl.Camera(16, 16, 4, 4, 8, 8)
    black = np.zeros((16, 16, 3), np.uint8)
    for k, towards in enumerate(((1.0, 0, 0.3), (-1, 0, 0.3), (0, 1, 0.3), (0, -1, 0.3), (0, 0, 1))):
        capture.add(black, camera, looking(towards, (0, 0, 0.05)), time=k / 30)
    assert (capture.environment().radiance.faces >= 0).all()


def test_centuries_between_bright_pictures():
    capture, camera = fastibl.Capture(size=8), camera_of(32, 24)
    for k in range(3):
        capture.add(np.full((24, 32, 3), 1e9, np.float32), camera, looking((1.0, 0, 0.2)), time=k * 1e30)
        capture.add(np.full((24, 32, 3), 0.5, np.float32), camera, looking((1.0, 0, 0.2)), time=k * 1e30)
        assert np.isfinite(capture.environment().radiance.faces).all()


def test_a_prior_of_denormal_values():
    prior = np.full((6, 16, 16, 3), 1e-45, np.float32)
    prior[4] = 0
    capture, camera = fastibl.Capture(size=16, prior=fastibl.CubeMap(prior)), camera_of(64, 48)
    for k in range(20):
        towards = (np.cos(k), np.sin(k), 0.4)
        capture.add(np.full((48, 64, 3), 200, np.uint8), camera, looking(towards), time=k / 30)
    faces = capture.environment().radiance.faces
    assert np.isfinite(faces).all() and (faces <= 1.001e9).all()


def test_what_is_unseen_keeps_to_the_cap():
    capture, camera = fastibl.Capture(size=8, board=fastibl.Board.default()), camera_of(32, 24)
    for k, towards in enumerate(((1.0, 0, 0.2), (0, 0, -1))):
        picture = np.full((24, 32, 3), 255, np.uint8)
        capture.add(picture, camera, looking(towards, (0, 0, 0.3)), exposure=1e-300, time=k / 30)
    assert (capture.environment().radiance.faces <= 1.001e9).all()


def test_pictures_of_one_row_tell_no_rotation():
    camera = fastibl.Camera(300, 1, 200, 200, 150, 0.5)
    tracker = fastibl.RotationTracker(camera)
    picture = np.zeros((1, 300, 3), np.uint8)
    tracker.start(looking((1.0, 0, 0)), 0.0, picture)
    environment = fastibl.Environment(fastibl.CubeMap(np.random.default_rng(0).random((6, 32, 32, 3))))
    assert tracker.track(environment, 0.1, picture) is None


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e30])
def test_detected_corners_that_are_none(bad):
    from fastibl._fastibl import _refine_corners, _track

    camera, board = camera_of(64, 48), fastibl.Board.grid(1, 2, 0.04, 0.01)
    tags = [(0, np.array([(10.0, 10), (bad, 10), (20, 20), (10, 20)]))]
    grey = np.zeros((48, 64), np.uint8)
    assert len(_refine_corners(grey, tags, 1, camera)) == 1
    assert _track(tags, None, board, camera, "board", grey) is None


@pytest.mark.parametrize("exponent", [1e6, 3e38])
def test_sampled_mirrors_of_dim_maps(exponent):
    lighting = fastibl.Lighting(fastibl.CubeMap(np.full((6, 8, 8, 3), 1e-30)), glossy="sampled")
    n, grazing = np.array([[0.0, 0, 1]]), np.array([[1.0, 0, 1e-8]])
    np.testing.assert_allclose(lighting.glossy(n, grazing, exponent), 1e-30, rtol=1e-5)


def test_a_near_light_of_no_radius_that_touches_the_plane():
    cube = fastibl.CubeMap(np.where(fastibl.texel_directions(16)[..., :1] > 0.9, 50.0, 0.1) * np.ones(3))
    environment = fastibl.Environment(cube, centre=(0, 0, 0.05), lights=[(0.2, 0.0, 0.0, 0.0), (0.2, 0, 0.001, 0)])
    shadow = fastibl.DirectionShadow(64).cast(environment, [(0, 0, 0.05, 0.04)], resolution=33, extent=0.4)
    assert ((shadow.image >= 0) & (shadow.image <= 1)).all()


@pytest.fixture
def rig_file(tmp_path):
    camera = fastibl.Camera(32, 24, 30, 30, 16, 12, [0.1, 0, 0, 0])
    write_rig(tmp_path / "rig.yaml", fastibl.Rig(camera))
    return tmp_path / "rig.yaml"


@pytest.mark.parametrize(
    "old, new",
    [
        ("rows: 3", "rows: 999999999"),
        ("cols: 3", "cols: -3"),
        ("rows: 3", "rows: 3.5"),
        ("data: [", "data: [ a,"),
        ("camera_matrix: !!opencv-matrix", "camera_matrix: 3\n   other: !!opencv-matrix"),
        ("width: 32", "width: 1e99"),
        ("gain: 1.", "gain: [ 1 ]"),
    ],
)
def test_a_broken_rig_is_named(old, new, rig_file):
    text = rig_file.read_text()
    assert old in text
    rig_file.write_text(text.replace(old, new, 1))
    same_error(lambda: read_rig(rig_file), ValueError)


def test_rigs_and_boards_come_back_as_they_were(rig_file, tmp_path):
    back = read_rig(rig_file).back
    assert (back.fx, back.cx, back.distortion) == (30, 16, (0.1, 0, 0, 0))
    board = fastibl.Board.grid(2, 3, 0.03, 0.01, 2)
    write_board(tmp_path / "board.yaml", board)
    assert read_board(tmp_path / "board.yaml") == board


def test_a_map_of_a_size_that_nobody_believes(tmp_path):
    path = tmp_path / "map.hdr"
    path.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1000000000 +X 2000000000\n")
    same_error(lambda: fastibl.read_environment(path), ValueError, "map.hdr")


def test_tags_of_other_ids_than_numbers():
    corners = np.array([(-0.02, 0.02), (0.02, 0.02), (0.02, -0.02), (-0.02, -0.02)])
    for id in (0.0, "0", None):
        same_error(lambda id=id: fastibl.Board([(id, corners)], 0.1, 0.1), TypeError, "whole number")
    for id in (-1, 587, 1 << 31, 1 << 80):
        same_error(lambda id=id: fastibl.Board([(id, corners)], 0.1, 0.1), ValueError)
    assert fastibl.Board([(np.int64(3), corners)], 0.1, 0.1).tags[0].id == 3


def test_a_mesh_of_two_coordinates_is_refused(tmp_path):
    (tmp_path / "flat.obj").write_text("v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n")
    with pytest.raises(ValueError, match="flat.obj .* line 1: expected three numbers"):
        fastibl.read_mesh(tmp_path / "flat.obj")


@pytest.mark.parametrize("model, parameters", [("phong", [1e5, 1e7, 1e9, 1e12]), ("ggx", [0.02, 1e-3, 1e-5, 1e-9])])
@pytest.mark.parametrize("size", [1, 4, 16])
def test_lobes_between_texels_are_mirrors(model, parameters, size):
    cube = fastibl.CubeMap(np.random.default_rng(3).uniform(0.5, 2, (6, size, size, 3)))
    lighting = fastibl.Lighting(cube, diffuse="sh9", glossy="mip")
    for finest in (size, 7, 64):
        for level in lighting.prefiltered(finest, model=model, parameters=parameters):
            assert level.faces.min() >= 0.5 - 1e-5 and level.faces.max() <= 2 + 1e-5  # false for NaN


@pytest.mark.parametrize(("height", "width", "size"), [(16, 31, 7), (24, 21, 7), (8, 37, 7), (64, 128, 32)])
def test_no_negative_radiance_beside_a_sun(height, width, size):
    for seed in range(200):
        image = np.random.default_rng(seed).choice([0, 1e-3, 1, 1e30], size=(height, width, 3)).astype(np.float32)
        assert fastibl.cubemap_from_equirect(image, size=size).faces.min() >= 0
