"""Vertices where the light that an object keeps from itself changes, and the backs of its surface."""

from collections import Counter

import numpy as np
import pytest
from test_gl import needs_gl
from test_occlusion import soup
from test_self_shadow import BOXES

import fastibl
from fastibl.extremes.views import looking
from fastibl.extremes.worlds import box_mesh

WHITE = fastibl.Material(diffuse=(0.5, 0.5, 0.5))
CAMERA = fastibl.Camera(96, 96, 150, 150, 48, 48)


def bowl(steps=12, radius=0.05):
    """Half a sphere, open at the top, its outside the front."""
    ring = np.arange(2 * steps) * np.pi / steps
    heights = np.linspace(np.pi / 2, np.pi, steps // 2 + 1)
    d = np.array([(np.sin(h) * np.cos(a), np.sin(h) * np.sin(a), np.cos(h)) for h in heights for a in ring])
    n = len(ring)
    triangles = []
    for row in range(len(heights) - 1):
        for k in range(n):
            a, b = row * n + k, row * n + (k + 1) % n
            triangles += [(a, a + n, b + n), (a, b + n, b)]
    return fastibl.Mesh(radius * d + (0, 0, radius), triangles, normals=d)


def wall_and_floor():
    """A wall on a floor of two triangles each, no vertex where its shadow falls; closed by nothing."""
    floor = [(-0.1, -0.1, 0), (0.1, -0.1, 0), (0.1, 0.1, 0), (-0.1, 0.1, 0)]
    wall = [(-0.02, 0, 0), (0.02, 0, 0), (0.02, 0, 0.08), (-0.02, 0, 0.08)]
    return fastibl.Mesh(np.array(floor + wall), [(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7)])


def sky():
    """Uniform, brighter on one side."""
    d = fastibl.texel_directions(32)
    return fastibl.CubeMap(np.where(d[..., 1:2] < -0.3, 3.0, 0.5) * np.ones(3))


def picture(scene, eye, cube, backend="cpu", methods=None):
    pose = looking(np.array([0, 0, 0.03]) - eye, eye)
    rig, environment = fastibl.Rig(CAMERA), fastibl.Environment(cube)
    chosen = {"self_shadow": "transfer", "bounce": "none", "diffuse": "irradiance-cube"}
    session = fastibl.Session(
        scene, rig, environment=environment, backend=backend, error=None, methods=methods or chosen
    )
    session.process(fastibl.Frame(0.0, back_from_marker=pose))
    layer, whole = session.object, np.zeros((96, 96, 4))
    part = layer.rgba
    whole[layer.y : layer.y + part.shape[0], layer.x : layer.x + part.shape[1]] = part
    return whole


@pytest.mark.parametrize("backend", ["cpu", pytest.param("gl", marks=needs_gl)])
def test_the_inside_of_a_bowl_sees_half_the_sky(backend):
    """In a sphere the form factor to an opening is its share of the sphere, wherever one is: a half."""
    scene = fastibl.Scene(bowl(steps=32), WHITE, spheres=0)
    uniform = fastibl.CubeMap(np.ones((6, 16, 16, 3)))
    inside = picture(scene, (0.0, -0.01, 0.4), uniform, backend)[40:56, 40:56]
    outside = picture(scene, (0.3, -0.3, 0.03), uniform, backend)[44:52, 44:52]
    assert (inside[..., 3] == 1).all() and (outside[..., 3] == 1).all()
    print(f"{backend}: inside {inside[..., 0].mean() / 0.5:.4f}, outside {outside[..., 0].mean() / 0.5:.4f}")
    np.testing.assert_allclose(inside[..., :3] / 0.5, 0.5, atol=0.02)
    np.testing.assert_allclose(outside[..., :3] / 0.5, 1, atol=0.01)


@needs_gl
def test_pictures_of_both_back_ends_are_alike_inside_and_outside():
    shiny = fastibl.Material(diffuse=(0.3, 0.3, 0.3), glossy=(0.3, 0.3, 0.3), exponent=32)
    scene = fastibl.Scene(bowl(), shiny, spheres=0)
    cpu, gl = (picture(scene, (0.1, -0.25, 0.2), sky(), backend) for backend in ("cpu", "gl"))
    off = np.abs(cpu - gl)
    print(f"largest difference {off.max():.4f}, mean {off.mean():.6f}")
    assert off.mean() < 1e-3 * cpu[..., :3].mean() and np.quantile(off, 0.999) < 0.01


def test_a_coarse_floor_gets_the_shadow_of_a_wall():
    coarse, n = wall_and_floor(), 160  # even: no vertex below the wall
    across, up = np.meshgrid(np.linspace(-1, 1, n), np.linspace(0, 1, n))
    floor = np.stack([0.1 * across, 0.2 * up - 0.1, 0 * up], -1).reshape(-1, 3)
    wall = np.stack([0.02 * across, 0 * up, 0.08 * up], -1).reshape(-1, 3)
    k = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    grid = np.concatenate([np.stack([k, k + 1, k + n + 1], 1), np.stack([k, k + n + 1, k + n], 1)])
    dense = fastibl.Mesh(np.concatenate([floor, wall]), np.concatenate([grid, grid + n * n]))
    eye, cube = (0.25, 0.3, 0.25), sky()
    true = picture(fastibl.Scene(dense, WHITE, spheres=0, refine=False), eye, cube)
    seen = (true[..., 3] == 1) & (picture(fastibl.Scene(coarse, WHITE, spheres=0), eye, cube)[..., 3] == 1)
    error = {}
    for refine in (False, True):
        scene = fastibl.Scene(coarse, WHITE, spheres=0, refine=refine)
        off = picture(scene, eye, cube)[seen][:, :3] - true[seen][:, :3]
        error[refine] = np.sqrt((off**2).mean()) / true[seen][:, :3].mean()
    count = len(fastibl.Scene(coarse, WHITE, spheres=0).refined_mesh.vertices)
    print(f"8 vertices: {error[False]:.3f}; {count}: {error[True]:.4f}; {2 * n * n} as truth")
    assert error[True] < 0.015 < 0.2 * error[False] and count < 5000


def edges_of(mesh):
    """How often each directed edge is there, vertices by place."""
    place = {}
    ids = [place.setdefault(tuple(v), len(place)) for v in mesh.vertices.tolist()]
    t = np.array(ids)[mesh.triangles]
    return Counter(map(tuple, np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]]).tolist()))


def area(mesh):
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles].astype(float), 1, 0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


def with_edges(mesh):
    """As a scene has it before anything is split."""
    return fastibl.Scene(mesh, spheres=0, visibility_rays=0).mesh


def test_a_refined_mesh_is_the_same_surface_without_cracks():
    vertices, triangles = box_mesh()
    three = np.concatenate([vertices + (dx, dy, 0) for dx, dy in ((0, 0), (0.08, 0), (0.03, 0.08))])
    closed = with_edges(fastibl.Mesh(three, np.concatenate([triangles + i * len(vertices) for i in range(3)])))
    scene = fastibl.Scene(closed, spheres=0)
    fine = scene.refined_mesh
    assert scene.mesh == closed and len(fine.vertices) > 2 * len(closed.vertices)
    np.testing.assert_array_equal(fine.vertices[: len(closed.vertices)], closed.vertices)
    np.testing.assert_allclose(area(fine), area(closed), rtol=1e-5)
    edges = edges_of(fine)
    assert all(edges[b, a] == count for (a, b), count in edges.items()), "an edge that ends in the middle of another"


def test_no_cracks_along_creases_whose_faces_have_vertices_of_their_own():
    fine = fastibl.Scene(BOXES, spheres=0).refined_mesh
    edges = edges_of(fine)
    assert len(fine.vertices) > 2 * len(BOXES.vertices)
    assert all(edges[b, a] == count for (a, b), count in edges.items()), "an edge that ends in the middle of another"


def test_a_refined_mesh_is_lit_as_the_given_one():
    """A glossy bowl of few faces, without self-shadow: normals are interpolated over the given triangles."""
    shiny = fastibl.Material(diffuse=(0, 0, 0), glossy=(0.8, 0.8, 0.8), exponent=100)
    d = fastibl.texel_directions(64)
    cube = fastibl.CubeMap(np.where((d @ [0.3, -0.4, 0.866])[..., None] > 0.97, 10.0, 0.3) * np.ones(3))
    made = [
        picture(
            fastibl.Scene(bowl(4), shiny, refine=refine),
            np.array([0.05, -0.2, 0.15]),
            cube,
            methods={"self_shadow": "none", "bounce": "none"},
        )
        for refine in (True, False)
    ]
    error = np.sqrt(((made[0] - made[1]) ** 2).mean()) / made[1].mean()
    count = len(fastibl.Scene(bowl(4), shiny).refined_mesh.vertices)
    print(f"{len(bowl(4).vertices)} vertices and {count}: {error:.2%} apart")
    assert count > 2 * len(bowl(4).vertices) and error < 0.01


def test_what_hides_nothing_is_split_where_it_is_long_alone():
    """An eighth of the mesh: what a near lamp does within longer edges no ends tell."""
    x, y = np.meshgrid(np.linspace(-0.1, 0.1, 13), np.linspace(-0.1, 0.1, 13))
    at = np.arange(169).reshape(13, 13)
    corners = [at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]]
    triangles = np.concatenate(
        [np.stack([corners[k] for k in t], axis=-1).reshape(-1, 3) for t in ((0, 1, 2), (0, 2, 3))]
    )
    plate = fastibl.Mesh(np.stack([x, y, 0.05 + 0 * x], axis=-1).reshape(-1, 3), triangles)
    assert fastibl.Scene(plate, spheres=0).refined_mesh.triangles.shape == plate.triangles.shape
    vertices, triangles = box_mesh()
    box = with_edges(fastibl.Mesh(vertices, triangles))
    refined = fastibl.Scene(box, spheres=0).refined_mesh
    corners = refined.vertices[refined.triangles]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1)
    longest = edges.max() / np.ptp(box.vertices, axis=0).max()
    print(f"a box: {len(box.vertices)} vertices become {len(refined.vertices)}, the longest edge {longest:.3f} of it")
    assert longest <= 1 / 8 + 1e-6 and len(refined.vertices) < 2000
    assert fastibl.Scene(soup(20), spheres=0, visibility_rays=0).refined_mesh == soup(20)
    assert fastibl.Scene(wall_and_floor(), spheres=0, refine=False).refined_mesh == with_edges(wall_and_floor())


def test_the_papers_occlusion_stays_what_it_was():
    eye, paper = (0.25, 0.3, 0.25), {"self_shadow": "ambient-occlusion", "bounce": "none"}
    scenes = [fastibl.Scene(wall_and_floor(), WHITE, spheres=0, refine=refine) for refine in (False, True)]
    np.testing.assert_array_equal(*(s.visibility for s in scenes))
    one, other = (picture(s, eye, sky(), methods=paper) for s in scenes)
    assert np.quantile(np.abs(one - other), 0.99) < 1e-5  # rounding moves a sample at an edge


def test_uvs_and_shares_at_seams():
    """Two halves of a plate that share no vertex: splits meet along the seam."""
    half = np.array([(-0.1, -0.1, 0), (0, -0.1, 0), (0, 0.1, 0), (-0.1, 0.1, 0)])
    plate = np.concatenate([half, half + (0.1, 0, 0)])
    wall = wall_and_floor().vertices[4:]
    uvs = np.concatenate([half[:, :2] * 5 + 0.5, half[:, :2] * 5 + 0.5, np.zeros((4, 2))])
    triangles = [(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7), (8, 9, 10), (8, 10, 11)]
    mesh = fastibl.Mesh(np.concatenate([plate, wall]), triangles, uvs=uvs)
    fine = fastibl.Scene(mesh, spheres=0).refined_mesh
    edges = edges_of(fine)
    at_seam = np.abs(places(fine)[:, 0]) < 1e-9
    on_seam = [(a, b) for a, b in edges if at_seam[a] and at_seam[b]]
    assert len(on_seam) > 4 and all(edges[b, a] == edges[a, b] for a, b in on_seam)
    left = (fine.vertices[:, 0] < -1e-6) & (np.abs(fine.vertices[:, 1]) > 1e-6)  # not the wall
    np.testing.assert_allclose(fine.uvs[left], (fine.vertices[left][:, :2] * 5 + 0.5), atol=1e-5)


def places(mesh):
    return np.array(list(dict.fromkeys(map(tuple, mesh.vertices.tolist()))))


def test_same_mesh_for_any_threads():
    before, found = fastibl.threads(), []
    try:
        for count in (1, 2):
            fastibl.set_threads(count)
            found.append(fastibl.Scene(soup(30), spheres=0).refined_mesh)
        assert found[0] == found[1]
    finally:
        fastibl.set_threads(before)
