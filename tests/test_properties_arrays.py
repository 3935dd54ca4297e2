"""Arrays of any shape, type and content: maps, light, shadows, meshes, materials, cameras."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

import fastibl
from hostile import MORE, anything, arrays, edges, filled, is_light, is_ratio, numbers, outcome, whole_numbers

FACES = st.one_of(st.integers(1, 5).flatmap(lambda n: filled((6, n, n, 3))), arrays((6, 2, 2, 3)))
VECTORS = arrays((3,), (4, 3), (2, 2, 3), (0, 3))
MAP = fastibl.CubeMap(np.random.default_rng(0).random((6, 8, 8, 3)))


@MORE
@given(FACES, VECTORS, numbers)
def test_maps(faces, directions, level):
    cube = outcome(lambda: fastibl.CubeMap(faces))
    if cube is None:
        return
    for k in range(cube.level_count):
        is_light(cube.level(k), 1e9)
    found = outcome(lambda: cube.sample(directions, level))
    if found is not None:
        is_light(found, 1.0001e9)
    assert cube == fastibl.CubeMap(cube.faces) or sum(cube.cleaned.values()) > 0


@MORE
@given(arrays((4, 8, 3), (1, 1, 3), (3, 5, 3)), whole_numbers, st.one_of(st.sampled_from(["area", "point"]), anything))
def test_equirectangular_pictures(image, size, filter):
    cube = outcome(lambda: fastibl.cubemap_from_equirect(image, size if size < 100 else 4, filter))
    if cube is not None:
        is_light(cube.faces, 1.0001e9)
        is_light(fastibl.equirect_from_cubemap(cube, 3))


@MORE
@given(
    st.integers(1, 4).flatmap(lambda n: filled((6, n, n, 3))),
    st.sampled_from(fastibl.methods("diffuse")),
    st.sampled_from(fastibl.methods("glossy")),
    VECTORS,
    VECTORS,
    st.one_of(numbers, filled((4,)), anything),
)
def test_light(faces, diffuse, glossy, normals, views, exponent):
    cube = fastibl.CubeMap(faces)
    lighting = fastibl.Lighting(cube, diffuse, glossy)
    most = 4 * np.pi * max(float(cube.faces.max()), 1e-30)
    for found in (
        outcome(lambda: lighting.irradiance(normals)),
        outcome(lambda: lighting.glossy(normals, views, exponent)),
        outcome(lambda: lighting.ggx(normals, views, exponent)),
    ):
        if found is not None:
            is_light(found, most)


@MORE
@given(
    arrays((4, 4), (0, 4), (1, 4)),
    arrays((5, 2), (2,)),
    anything,
    st.sampled_from(["directions", "cap-sum", "cap-product"]),
)
def test_shadows(spheres, points, directions, method):
    found = outcome(lambda: fastibl.shadow_ratio(MAP, spheres, points, method))
    if found is not None:
        is_ratio(found)
    found = outcome(lambda: fastibl.cast_shadow(MAP, spheres, method, resolution=8, directions=directions))
    if found is not None:
        is_ratio(found.image)
        is_ratio(found.sample(np.array([(0.0, 0.0), (np.nan, 1.0), (1e30, -1e30)])))


TRIANGLES = st.one_of(
    st.lists(st.tuples(*[st.integers(0, 4)] * 3), min_size=1, max_size=6).map(lambda t: np.array(t)),
    st.lists(st.tuples(*[whole_numbers] * 3), max_size=3).map(lambda t: np.array(t, dtype=object)),
    arrays((2, 3)),
)


@MORE
@given(arrays((5, 3), (5, 3), (1, 3)), TRIANGLES, st.one_of(st.none(), st.none(), arrays((5, 2))), VECTORS)
def test_meshes(vertices, triangles, uvs, directions):
    mesh = outcome(lambda: fastibl.Mesh(vertices, triangles, uvs))
    if mesh is None:
        return
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-3)
    np.testing.assert_allclose(np.linalg.norm(mesh.tangents[:, :3], axis=1), 1, atol=1e-3)
    is_ratio(fastibl.ambient_occlusion(mesh, 8))
    spheres = outcome(lambda: fastibl.fit_spheres(mesh, 3, resolution=8))
    if spheres is not None:
        assert len(spheres) >= 1 and np.isfinite(spheres).all() and (spheres[:, 3] > 0).all()
    found = outcome(lambda: fastibl.Bvh(mesh).nearest(np.zeros(3), directions))
    if found is not None:
        triangle, t, _ = found
        assert (triangle < len(mesh.triangles)).all() and np.isfinite(t[triangle >= 0]).all()
    standing = outcome(lambda: fastibl.stand(mesh, 0.1))
    if standing is not None:
        assert np.isfinite(standing.vertices).all()


COLOURS = st.one_of(st.tuples(numbers, numbers, numbers), arrays((3,), (2, 2, 3)))


@MORE
@given(COLOURS, COLOURS, st.one_of(numbers, anything), COLOURS)
def test_materials(diffuse, glossy, exponent, emission):
    material = outcome(lambda: fastibl.Material(diffuse, glossy, exponent, emission))
    if material is not None:
        is_light(material.diffuse), is_light(material.glossy), is_light(material.emission)
        assert material.exponent >= 0
    material = outcome(lambda: fastibl.Material.pbr(diffuse, exponent, exponent, emission=emission))
    if material is not None:
        is_ratio(material.roughness)


@MORE
@given(
    st.tuples(*[whole_numbers] * 2),
    st.tuples(*[st.one_of(st.floats(1, 500), numbers)] * 4),
    st.lists(numbers, max_size=9),
    st.lists(numbers, max_size=3),
    st.sampled_from(["perspective", "fisheye", "equirectangular", ""]),
    arrays((4, 3), (3,)),
    arrays((4, 2), (2,)),
)
def test_cameras(size, lens, distortion, vignetting, model, points, pixels):
    camera = outcome(lambda: fastibl.Camera(*size, *lens, distortion, vignetting=vignetting, model=model))
    if camera is None:
        return
    for found in (outcome(lambda: camera.project(points)), outcome(lambda: camera.unproject(pixels))):
        if found is not None:  # NaN where there is none
            assert not np.isinf(found).any()


@MORE
@given(arrays((4, 4), (3, 4)), arrays((3,)), arrays((3,)))
def test_poses(matrix, rotation, translation):
    pose = outcome(lambda: fastibl.Pose(matrix))
    if pose is not None:
        np.testing.assert_allclose((pose @ pose.inverse()).rotation, np.eye(3), atol=1e-5)
    pose = outcome(lambda: fastibl.Pose.from_rotation_vector(rotation, translation))
    if pose is not None:
        assert np.isfinite(pose.matrix).all()


@MORE
@given(st.lists(numbers, max_size=6), numbers, arrays((5,), (2, 2)))
def test_responses(curve, gamma, values):
    for make in (lambda: fastibl.Response.from_curve(curve), lambda: fastibl.Response.gamma(gamma)):
        response = outcome(make)
        if response is None:
            continue
        for found in (outcome(lambda r=response: r.decode(values)), outcome(lambda r=response: r.encode(values))):
            if found is not None:
                is_ratio(found)


@MORE
@given(
    st.sampled_from(["ggx", "phong", "blinn", "magic"]),
    st.lists(st.one_of(numbers, st.sampled_from(edges)), max_size=3),
    st.floats(0.01, 2),
)
def test_prefiltered_maps(model, parameters, error):
    found = outcome(lambda: fastibl.Lighting(MAP).prefiltered(4, model=model, parameters=parameters, error=error))
    for level in found or ():
        is_light(level.faces, 1.01)
