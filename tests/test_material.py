"""Materials of glTF's model: textures, normal maps, energy, .glb files, both back ends."""

import functools
import json
import pickle

import numpy as np
import pytest
from scenes import scene_of
from test_gl import needs_gl
from test_mesh_files import Gltf

import fastibl
from conftest import in_picture, same_error
from fastibl import reference
from views import camera_of, looking

EYE, CENTRE = np.array((0.15, -0.25, 0.15)), np.array((0.0, 0.0, 0.05))
CAMERA, POSE = camera_of(160, 120, 26.0), looking(CENTRE - EYE, EYE)
WHITE = fastibl.CubeMap(np.ones((6, 8, 8, 3), np.float32))


def sphere(rings=48, uvs=True):
    """A ball of radius 0.05 on the plane; u runs around z, v upwards."""
    u, v = np.meshgrid(np.linspace(0, 1, 2 * rings + 1), np.linspace(0, 1, rings + 1))
    theta, phi = (1 - v) * np.pi, u * 2 * np.pi
    n = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1).reshape(-1, 3)
    i = np.arange(len(n)).reshape(rings + 1, -1)
    a, b, c, d = i[:-1, :-1].ravel(), i[:-1, 1:].ravel(), i[1:, 1:].ravel(), i[1:, :-1].ravel()
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return fastibl.Mesh(n * 0.05 + CENTRE, triangles, np.stack([u, v], axis=-1).reshape(-1, 2) if uvs else None, n)


def square(size=0.1, repeat=1.0, normals=None):
    """Lies flat; seen from above, u to the right (x) and v upwards (y)."""
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], float)
    return fastibl.Mesh(corners * size, [[0, 1, 2], [0, 2, 3]], (corners[:, :2] + 1) / 2 * repeat, normals)


def layer_of(mesh, material, source, camera=CAMERA, pose=POSE, backend="cpu", methods="auto"):
    """(h, w, 4) of the object alone."""
    scene = fastibl.Scene(mesh, material, spheres=0, visibility_rays=0)
    session = fastibl.Session(scene, fastibl.Rig(camera), environment=source, backend=backend, methods=methods, error=0)
    session.process(fastibl.Frame(0.0, back_from_marker=pose))
    return in_picture(session.object, camera, np.float64)


ABOVE = looking((0, 0, -1), (0.0, 0.0, 0.5))  # x to the right, y upwards
FROM_ABOVE = camera_of(64, 64, 2 * np.degrees(np.arctan(0.2)))  # the square of 0.1 fills it


def emitting(texture, mesh=None):
    """What a texture looks like as emission of the square from above."""
    material = fastibl.Material.pbr((0, 0, 0), 1.0, 1.0, emission=texture)
    black = fastibl.CubeMap(np.zeros((6, 4, 4, 3), np.float32))
    return layer_of(mesh or square(), material, black, FROM_ABOVE, ABOVE)[..., :3]


# --- what it is made of


def test_constants_and_textures():
    rng = np.random.default_rng(0)
    colour, rough = rng.integers(0, 256, (5, 7, 3), dtype=np.uint8), rng.random((3, 4))
    m = fastibl.Material.pbr(colour, 0.25, rough, emission=(1, 2, 3))
    linear = np.where(colour / 255 <= 0.04045, colour / 255 / 12.92, ((colour / 255 + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(m.base_color, linear, rtol=1e-5)
    np.testing.assert_allclose(m.roughness, rough, rtol=1e-6)
    assert m.metallic == 0.25 and m.emission == (1, 2, 3) and m.normal is None and m.model == "pbr"
    assert "<texture 7 x 5>" in repr(m) and m.diffuse is None and m.exponent is None
    np.testing.assert_allclose(fastibl.Material.pbr(metallic=np.uint8([[0, 255]])).metallic, [[0, 1]])
    normal = rng.random((2, 2, 3)).astype(np.float32)
    np.testing.assert_allclose(fastibl.Material.pbr(normal=normal).normal, normal, atol=1e-6)
    plain = fastibl.Material()
    assert plain.model == "blinn-phong" and plain.base_color is None and plain.diffuse == pytest.approx((0.8,) * 3)


def test_equality_and_pickles():
    texture = np.random.default_rng(1).random((4, 4, 3))
    look = {
        "base_color": texture, "metallic": 0.5, "roughness": 0.3, "normal": texture, "anisotropy": 0.4,
        "anisotropy_rotation": 1.0, "ior": 2.0, "specular": 0.5, "specular_color": (1, 2, 0.5),
    }  # fmt: skip
    make = fastibl.Material.pbr
    assert make(**look) == make(**look) and pickle.loads(pickle.dumps(make(**look))) == make(**look)
    for other in ({"normal": None}, {"ior": 1.5}, {"specular": 1.0}, {"specular_color": (1, 1, 1)}):
        assert make(**look) != make(**look | other)
    assert "ior=2.0, specular=0.5, specular_color=(1.0, 2.0, 0.5)" in repr(make(**look))
    assert make(**look) != fastibl.Material()
    plain = fastibl.Material(diffuse=(0.1, 0.2, 0.3))
    assert pickle.loads(pickle.dumps(plain)) == plain
    mesh = sphere(4)
    assert pickle.loads(pickle.dumps(mesh)) == mesh and fastibl.stand(mesh, 0.1).uvs.shape == mesh.uvs.shape


def test_bad_input_is_named():
    pbr = fastibl.Material.pbr
    same_error(lambda: pbr((0.5, 1.5, 0)), ValueError, "base_color", "1.5")
    same_error(lambda: pbr((0.5, 0.5)), ValueError, "base_color", "three numbers", "(2,)")
    same_error(lambda: pbr(np.zeros((4, 4))), ValueError, "base_color", "(height, width, 3)", "(4, 4)")
    same_error(lambda: pbr(np.zeros((4, 4, 4))), ValueError, "base_color", "(4, 4, 4)")
    same_error(lambda: pbr(np.zeros((0, 4, 3))), ValueError, "base_color", "(0, 4, 3)")
    same_error(lambda: pbr(np.full((2, 2, 3), 2.0)), ValueError, "base_color", "0 to 1", "2")
    same_error(lambda: pbr(np.zeros((4, 4, 3), np.int32)), TypeError, "base_color", "int32")
    same_error(lambda: pbr(metallic=1.5), ValueError, "metallic", "0 to 1", "1.5")
    same_error(lambda: pbr(roughness=np.nan), ValueError, "roughness", "nan")
    same_error(lambda: pbr(roughness="rough"), TypeError, "roughness", "str")
    same_error(lambda: pbr(roughness=np.zeros((4, 4, 3))), ValueError, "roughness", "(4, 4, 3)")
    same_error(lambda: pbr(metallic=np.full((2, 2), np.nan)), ValueError, "finite")
    same_error(lambda: pbr(normal=(0, 0, 1)), TypeError, "normal", "tuple")
    same_error(lambda: pbr(emission=(-1, 0, 0)), ValueError, "emission", "-1")
    same_error(lambda: pbr(anisotropy=2), ValueError, "anisotropy", "2")
    for ior in (0.5, -1, np.nan, np.inf):
        same_error(lambda ior=ior: pbr(ior=ior), ValueError, "ior must be at least 1, or 0")
    same_error(lambda: pbr(specular=1.5), ValueError, "specular", "0 to 1", "1.5")
    same_error(lambda: pbr(specular_color=(1, -1, 1)), ValueError, "specular_color", "-1")
    same_error(lambda: pbr(specular_color=1.0), TypeError, "specular_color")
    same_error(
        lambda: fastibl.Mesh(np.zeros((3, 3)), [[0, 1, 2]], normals=np.zeros((2, 3))), ValueError, "normals", "2"
    )


def test_textures_need_uvs():
    textured, bare = fastibl.Material.pbr(np.ones((2, 2, 3))), sphere(8, uvs=False)
    same_error(lambda: fastibl.Scene(bare, textured, spheres=0), ValueError, "uvs")
    session = fastibl.Session(fastibl.Scene(bare, spheres=0), fastibl.Rig(CAMERA), environment=WHITE)
    same_error(lambda: session.set_material(textured), ValueError, "uvs")
    layer_of(bare, fastibl.Material.pbr(metallic=1.0, anisotropy=0.8), WHITE)  # its tangent needs none


# --- where textures lie


def test_row_0_is_at_the_top():
    texture = np.zeros((8, 8, 3))
    texture[:4, :4], texture[:4, 4:], texture[4:, :4] = (1, 0, 0), (0, 1, 0), (0, 0, 1)
    seen = emitting(texture)
    for row, column, colour in ((10, 10, (1, 0, 0)), (10, 50, (0, 1, 0)), (50, 10, (0, 0, 1)), (50, 50, (0, 0, 0))):
        np.testing.assert_allclose(seen[row, column], colour, atol=1e-5)


def test_textures_are_filtered():
    ramp = np.broadcast_to((np.arange(8) / 8)[None, :, None], (8, 8, 3))
    seen = emitting(ramp)[32, 8:56, 0]  # bilinear between texels 8 pixels wide
    assert np.abs(np.diff(seen) - 1 / 64).max() < 2e-3
    checker = np.indices((64, 64)).sum(axis=0) % 2 * np.ones((3, 1, 1))
    small = emitting(np.ascontiguousarray(checker.transpose(1, 2, 0)), square(repeat=16))
    assert np.abs(small[2:-2, 2:-2] - 0.5).max() < 1e-3  # 16 texels a pixel: the mean of the checkers
    repeated = emitting(np.where(np.arange(8) < 4, 1.0, 0)[None, :, None] * np.ones((8, 1, 3)), square(repeat=2))
    assert repeated[32, 8, 0] > 0.9 > 0.1 > repeated[32, 24, 0] and repeated[32, 40, 0] > 0.9


@pytest.mark.parametrize("width", [2, 3, 5, 7, 8, 15, 33])
def test_levels_keep_the_mean_of_odd_sizes(width):
    """A texture smaller than a pixel shows the mean of all of its texels, also of the last column and row."""
    picture = np.zeros((width, width, 3), np.float32)
    picture[:, -1, 0], picture[-1, :, 1] = 1, 1
    seen = emitting(picture, square(repeat=200))
    np.testing.assert_allclose(seen[32, 32, :2], 1 / width, rtol=0.02)


def test_metallic_and_roughness_maps():
    """A map whose halves hold two values looks like the two materials."""
    rng = np.random.default_rng(3)
    source = fastibl.CubeMap(rng.uniform(0.2, 2, (6, 16, 16, 3)).astype(np.float32))
    halves = lambda a, b: np.where(np.arange(8) < 4, a, b)[None].repeat(8, 0).astype(float)  # noqa: E731
    both = layer_of(square(), fastibl.Material.pbr((0.8, 0.4, 0.2), halves(1, 0), halves(0.2, 0.7)), source,
                    FROM_ABOVE, ABOVE)  # fmt: skip
    left = layer_of(square(), fastibl.Material.pbr((0.8, 0.4, 0.2), 1.0, 0.2), source, FROM_ABOVE, ABOVE)
    right = layer_of(square(), fastibl.Material.pbr((0.8, 0.4, 0.2), 0.0, 0.7), source, FROM_ABOVE, ABOVE)
    np.testing.assert_allclose(both[4:-4, 4:26], left[4:-4, 4:26], atol=1e-5)
    np.testing.assert_allclose(both[4:-4, 38:-4], right[4:-4, 38:-4], atol=1e-5)


# --- tangents and normal maps


def test_tangents():
    flat = square().tangents
    np.testing.assert_allclose(flat, np.broadcast_to([1, 0, 0, 1], flat.shape), atol=1e-6)
    mirrored = fastibl.Mesh(square().vertices, square().triangles, square().uvs * [-1, 1]).tangents
    np.testing.assert_allclose(mirrored, np.broadcast_to([-1, 0, 0, -1], flat.shape), atol=1e-6)
    ball = sphere(48)
    inside = np.abs(ball.normals[:, 2]) < 0.95
    around = np.cross([0, 0, 1], ball.normals)
    around /= np.maximum(np.linalg.norm(around, axis=1, keepdims=True), 1e-9)
    assert (np.einsum("ij,ij->i", ball.tangents[:, :3], around)[inside] > 0.999).all()
    assert (ball.tangents[inside, 3] == 1).all()
    bare = sphere(48, uvs=False).tangents  # around z as well
    assert (np.einsum("ij,ij->i", bare[:, :3], around)[inside] > 0.999).all()
    degenerate = fastibl.Mesh(ball.vertices, ball.triangles, np.zeros_like(ball.uvs)).tangents
    assert np.isfinite(degenerate).all()
    np.testing.assert_allclose(np.linalg.norm(degenerate[:, :3], axis=1), 1, atol=1e-5)


@pytest.mark.parametrize("mirror", [1, -1])
def test_normal_map_bends_normals(mirror, marked):
    """A map of one tilted normal looks like a mesh with that normal."""
    source = marked
    mesh = fastibl.Mesh(square().vertices, square().triangles, square().uvs * [mirror, 1])
    tilted = np.array([0.3, 0.5, 0.8]) / np.linalg.norm([0.3, 0.5, 0.8])
    texture = np.broadcast_to(tilted * 0.5 + 0.5, (4, 4, 3))
    for options in (dict(metallic=1.0, roughness=0.3), dict(metallic=0.0, roughness=0.8)):
        mapped = layer_of(mesh, fastibl.Material.pbr(normal=texture, **options), source, FROM_ABOVE, ABOVE)
        world = tilted * [mirror, 1, 1]  # u along ±x, v along y
        true = layer_of(square(normals=np.tile(world, (4, 1))), fastibl.Material.pbr(**options), source,
                        FROM_ABOVE, ABOVE)  # fmt: skip
        np.testing.assert_allclose(mapped, true, atol=1e-2)
        flat = layer_of(mesh, fastibl.Material.pbr(normal=texture, normal_scale=0.0, **options), source,
                        FROM_ABOVE, ABOVE)  # fmt: skip
        plain = layer_of(mesh, fastibl.Material.pbr(**options), source, FROM_ABOVE, ABOVE)
        np.testing.assert_allclose(flat, plain, atol=1e-4)
        assert np.abs(mapped - plain).max() > 0.02


# --- light


@pytest.mark.parametrize("anisotropy", [0.0, 0.7])
@pytest.mark.parametrize("metallic", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("roughness", [0.02, 0.3, 1.0])
def test_white_furnace(roughness, metallic, anisotropy):
    """A white object in a white map is white, whatever it is made of."""
    seen = layer_of(sphere(), fastibl.Material.pbr((1, 1, 1), metallic, roughness, anisotropy=anisotropy), WHITE)
    inside = seen[..., 3] == 1
    error = np.abs(seen[inside, :3] - 1).max()
    print(f"roughness {roughness}, metallic {metallic}, anisotropy {anisotropy}: furnace off by {error:.1e}")
    # Diffuse irradiance of the white map is itself 1e-4 from pi.
    assert inside.sum() > 2000 and error <= 1e-3


def test_reflectance_follows_the_split_sum():
    """In a white map, colour shows the reflectance: against quadrature of the oracle, with Schlick by hand."""
    for base, metallic, roughness in (((1.0, 0.7, 0.3), 1.0, 0.5), ((0, 0, 0), 0.0, 0.3)):
        seen = layer_of(square(), fastibl.Material.pbr(base, metallic, roughness), WHITE, FROM_ABOVE, ABOVE)[32, 32, :3]
        alpha = (roughness**2,) * 2
        whole = reference.ggx_albedo(1.0, alpha)  # Schlick's rest is 0 but for the roughness, at normal incidence
        a, b = fastibl.ggx_albedo(np.array([0.0, 0, 1]), alpha=np.array(alpha))
        assert a + b == pytest.approx(whole, abs=1e-3) and b < 0.01
        f0 = np.array(base) if metallic else np.full(3, 0.04)
        np.testing.assert_allclose(seen, (f0 * a + b) * (1 + f0 * (1 / whole - 1)), atol=1e-3)


@pytest.mark.parametrize("ior", [0, 1, 1.33, 1.5, 2.4])
@pytest.mark.parametrize("specular", [0.0, 0.4, 1.0])
def test_a_dielectric_reflects_all_or_hands_it_down(ior, specular):
    """A white one under white light is white, whatever it reflects; a black one shows what it reflects."""
    for roughness, color in ((0.1, (1, 1, 1)), (0.7, (1, 1, 1)), (0.5, (3, 1, 0.2))):
        look = {"ior": ior, "specular": specular, "specular_color": color}
        white, black = (
            layer_of(sphere(), fastibl.Material.pbr((base,) * 3, 0.0, roughness, **look), WHITE) for base in (1, 0)
        )
        inside = white[..., 3] == 1
        f0 = np.minimum(((ior - 1) / (ior + 1)) ** 2 * np.array(color), 1)
        if len(set(f0)) == 1:
            np.testing.assert_allclose(white[inside][:, :3], 1, atol=2e-3)
        assert white[inside][:, :3].max() < 1.002  # as little of every colour goes down as of the strongest
        middle = black[np.argwhere(inside).mean(axis=0).astype(int)[0], np.argwhere(inside).mean(axis=0).astype(int)[1]]
        a, c = fastibl.ggx_albedo(np.array([0.0, 0, 1]), alpha=np.full(2, max(roughness**2, 0.02)))
        np.testing.assert_allclose(middle[:3], specular * (f0 * a + c) * (1 + f0 * (1 / (a + c) - 1)), atol=3e-3)


@pytest.mark.parametrize("degrees", [0, 60, 80])
def test_ior_and_specular_against_the_lobe(degrees):
    """Direction by direction, with Schlick's term: KHR_materials_ior and KHR_materials_specular."""
    d = fastibl.texel_directions(64)
    source = fastibl.CubeMap((0.2 + 3 * np.exp(-6 * np.abs(d[..., 2:] - 0.15)) * [1.0, 0.7, 0.5]).astype(np.float32))
    fine_white = fastibl.CubeMap(np.ones((6, 64, 64, 3), np.float32))
    for ior, specular, color in ((1.33, 1.0, (1, 1, 1)), (2.4, 0.6, (1, 1, 1)), (1.5, 1.0, (2, 1, 0.25))):
        f0 = np.minimum(((ior - 1) / (ior + 1)) ** 2 * np.array(color), 1)
        true = specular * by_fresnel(degrees, source, f0, 0.25)
        look = {"ior": ior, "specular": specular, "specular_color": color}
        seen = seen_under(degrees, fastibl.Material.pbr((0, 0, 0), 0.0, 0.5, **look), source,
                          {"glossy": fastibl.Method("sampled", taps=4096)})  # fmt: skip
        print(f"{degrees} degrees, {look}: off by {100 * np.abs(seen / true - 1).max():.2f} %")
        np.testing.assert_allclose(seen, true, rtol=0.01)
        # What it keeps back is missing below.
        reflects = specular * by_fresnel(degrees, fine_white, f0, 0.25)
        both = seen_under(degrees, fastibl.Material.pbr((0.5,) * 3, 0.0, 0.5, **look), WHITE, "auto")
        np.testing.assert_allclose(both, reflects + 0.5 * (1 - reflects.max()), atol=5e-3)


def test_gltf_ior_and_specular(tmp_path):
    def part(index, extensions, metallic=0.0, size=1.0):
        look = {"pbrMetallicRoughness": {"baseColorFactor": [0.1 * (index + 1)] * 3 + [1], "metallicFactor": metallic},
                "extensions": extensions}  # fmt: skip
        corners = square().vertices * size + [3 * index, 0, 0]
        attributes = {"POSITION": file.add(corners.astype("<f4"))}
        return {"attributes": attributes, "indices": file.add(np.uint16([0, 1, 2, 0, 2, 3])), "material": index}, look

    def material_of(*specs):
        parts, looks = zip(*(part(k, *spec) for k, spec in enumerate(specs)), strict=True)
        return fastibl.read_object(file.write(tmp_path / "a.gltf", list(parts), materials=list(looks)))[1]

    ior, strength = {"KHR_materials_ior": {"ior": 2.0}}, {"KHR_materials_specular": {"specularFactor": 0.5}}
    colour = {"KHR_materials_specular": {"specularColorFactor": [2, 1, 0.5]}}
    file = Gltf()
    m = material_of((ior | strength,))
    assert (m.ior, m.specular, m.specular_color) == (2.0, 0.5, (1, 1, 1))
    file = Gltf()
    m = material_of((colour,), (colour,), ({}, 1.0))  # the metal's do not matter
    assert (m.ior, m.specular) == (1.5, 1.0) and m.specular_color == pytest.approx((2, 1, 0.5))
    file = Gltf()
    with pytest.warns(UserWarning, match="a.gltf: what its materials reflect .* becomes their mean"):
        m = material_of(({},), (ior | strength, 0.0, 2.0))  # of which the second has four times the area
    assert m.specular == pytest.approx(0.6)
    f0 = ((m.ior - 1) / (m.ior + 1)) ** 2 * np.array(m.specular_color)
    np.testing.assert_allclose(0.6 * f0, (0.2 * 0.04 + 0.8 * 0.5 / 9), rtol=1e-4)
    file = Gltf()
    with pytest.warns(UserWarning, match="left out are textures of KHR_materials_specular"):
        material_of(({"KHR_materials_specular": {"specularColorTexture": {"index": 0}}},))


def test_nothing_overflows():
    faces = np.zeros((6, 64, 64, 3), np.float32)
    faces[4, 31, 31] = 1e6
    for source in (fastibl.CubeMap(faces), fastibl.CubeMap(np.zeros((6, 4, 4, 3), np.float32))):
        for roughness, anisotropy in ((0.0, 0.0), (0.0, 1.0), (1.0, 0.0)):
            seen = layer_of(sphere(), fastibl.Material.pbr((1, 1, 1), 0.5, roughness, anisotropy=anisotropy), source)
            assert np.isfinite(seen).all() and (seen >= 0).all()


def test_plan_reads_what_the_material_needs():
    def reads(material):
        scene = scene_of(sphere(8), material, spheres=0)
        plan = fastibl.Session(scene, fastibl.Rig(CAMERA), environment=WHITE).plan
        return {line.name: set(line.reads) for line in plan.passes}["shade"]

    assert {"radiance", "irradiance"} <= reads(fastibl.Material.pbr())
    metal = reads(fastibl.Material.pbr(metallic=1.0))
    assert "radiance" in metal and "irradiance" not in metal
    assert "irradiance" in reads(fastibl.Material.pbr(metallic=np.ones((2, 2))))
    assert "radiance" not in reads(fastibl.Material())


def test_a_scene_with_another_material_keeps_what_its_mesh_hides():
    """As a new one of it would be; sessions and materials that were handed out before stay as they are."""
    scene, red, matte = (fastibl.Scene(sphere(12)), fastibl.Material.pbr((0.8, 0.1, 0.1), 0.0, 0.4), fastibl.Material())
    session = fastibl.Session(scene, fastibl.Rig(CAMERA), environment=WHITE)
    before = scene.material
    scene.material = red
    assert scene.material == red and before == matte

    def drawn(session):
        session.process(fastibl.Frame(0.0, back_from_marker=POSE))
        return session.object.rgba

    old, changed, fresh = (
        drawn(session),
        drawn(fastibl.Session(scene, fastibl.Rig(CAMERA), environment=WHITE)),
        drawn(fastibl.Session(fastibl.Scene(sphere(12), red), fastibl.Rig(CAMERA), environment=WHITE)),
    )
    np.testing.assert_array_equal(changed, fresh)
    assert old[..., 1].max() > 2 * changed[..., 1].max() > 0
    bare = fastibl.Scene(fastibl.Mesh(square().vertices, square().triangles), spheres=0)
    textured = fastibl.Material.pbr(np.ones((2, 2, 3)))
    same_error(lambda: setattr(bare, "material", textured), ValueError, "uvs")
    same_error(lambda: setattr(bare, "material", None), TypeError, "Material", "None")
    assert bare.material == matte


# --- GL


def full_material(anisotropy=0.0):
    rng = np.random.default_rng(6)
    soft = lambda n, c: np.kron(rng.uniform(0, 1, (8, 8, c)), np.ones((n // 8, n // 8, 1)))  # noqa: E731
    normal = (soft(32, 3) - 0.5) * [0.6, 0.6, 0] + [0.5, 0.5, 1]
    return fastibl.Material.pbr(
        soft(64, 3), soft(16, 1)[..., 0], soft(32, 1)[..., 0] * 0.7 + 0.15, normal, soft(16, 3) * 0.2,
        anisotropy=anisotropy, anisotropy_rotation=0.4,
    )  # fmt: skip


@pytest.mark.parametrize("backend", ["cpu", pytest.param("gl", marks=needs_gl)])
@pytest.mark.parametrize("kind", ["bumps", "brushed"])
def test_a_mirrored_unwrapping_is_the_same_surface(marked, backend, kind):
    """Where v runs the other way a bump stays a bump, and a brush is turned the other way round."""
    mesh = square()
    mirrored = fastibl.Mesh(mesh.vertices, mesh.triangles, mesh.uvs * (1, -1) + (0, 1))
    if kind == "bumps":
        bumps = np.random.default_rng(0).uniform((0.25, 0.25, 0.9), (0.75, 0.75, 0.9), (4, 4, 3)).astype(np.float32)
        turned = np.abs(bumps[::-1] - np.float32([0, 1, 0]))
        materials = [fastibl.Material.pbr((0.9, 0.8, 0.7), 1.0, 0.3, normal=n) for n in (bumps, turned)]
    else:
        materials = [
            fastibl.Material.pbr((0.9, 0.8, 0.7), 1.0, 0.4, anisotropy=0.9, anisotropy_rotation=r) for r in (0.6, -0.6)
        ]
    pose = looking((0, 1, -1), (0.0, -0.4, 0.4))
    one, other, wrong = (
        layer_of(m, of, marked, FROM_ABOVE, pose, backend)[..., :3]
        for m, of in ((mesh, materials[0]), (mirrored, materials[1]), (mirrored, materials[0]))
    )
    print(f"off by {np.abs(other - one).max():.1e}; as it is unwrapped first {np.abs(wrong - one).max():.3f}")
    assert np.abs(other - one).max() < 1e-3 and np.abs(wrong - one).max() > 0.05


def seen_under(degrees, material, source, methods):
    """Colour (3,) at the middle of a picture of the square, seen under this angle from its normal."""
    eye = 0.5 * np.array([np.sin(np.radians(degrees)), 0.0, np.cos(np.radians(degrees))])
    layer = layer_of(square(), material, source, camera_of(33, 33, 4.0), looking(-eye, eye), methods=methods)
    return layer[16, 16, :3]


def by_fresnel(degrees, source, f0, alpha):
    """The same of single scattering by a metal: the lobe, Schlick's term and the map, direction by direction."""
    theta = np.radians(degrees)
    v = np.array([np.sin(theta), 0, np.cos(theta)])
    d, angles, radiance = reference.samples(source)
    h = d + v
    vh = np.clip((h / np.maximum(np.linalg.norm(h, axis=1, keepdims=True), 1e-9)) @ v, 0, 1)
    lobe = reference._ggx_lobe(d, v, np.eye(3), (alpha, alpha)) * angles
    whole = lobe.sum()
    fresnel = f0 + (1 - f0) * (1 - vh[:, None]) ** 5
    return (lobe[:, None] * fresnel * radiance).sum(axis=0) * (1 + f0 * (1 / whole - 1))


@pytest.mark.parametrize("degrees", [0, 60, 75, 82])
def test_fresnel_is_a_part_of_the_lobe(degrees):
    """Towards grazing directions a lobe reflects more: light from there counts more than the lobe's average of it."""
    d = fastibl.texel_directions(64)
    source = fastibl.CubeMap((0.2 + 3 * np.exp(-6 * np.abs(d[..., 2:] - 0.15)) * [1.0, 0.7, 0.5]).astype(np.float32))
    f0, alpha, view = (
        np.array([0.3, 0.2, 0.1]),
        0.25,
        np.array([np.sin(np.radians(degrees)), 0, np.cos(np.radians(degrees))]),
    )
    true = by_fresnel(degrees, source, f0, alpha)
    average = reference.ggx(source, np.array([0, 0, 1.0]), view, alpha=(alpha, alpha))
    a, c = fastibl.ggx_albedo(view, alpha=(alpha, alpha))
    split = (f0 * a + c) * (1 + f0 * (1 / (a + c) - 1)) * average
    metal, off = fastibl.Material.pbr(tuple(f0), 1.0, 0.5), {"split": np.abs(split / true - 1).max()}
    for name in (fastibl.Method("sampled", taps=4096), fastibl.Method("stretched", lights=0)):
        off[name.name] = np.abs(seen_under(degrees, metal, source, {"glossy": name}) / true - 1).max()
    print(f"{degrees} degrees: " + ", ".join(f"{k} {100 * v:.1f} %" for k, v in off.items()))
    assert off["sampled"] < 0.01
    if degrees > 60:
        assert off["stretched"] < 0.7 * off["split"]


@needs_gl
@pytest.mark.parametrize("glossy", ["mip", "stretched", fastibl.Method("sampled", taps=32)], ids=str)
@pytest.mark.parametrize(
    "material",
    [
        fastibl.Material.pbr((0.9, 0.6, 0.3), 1.0, 0.25),
        fastibl.Material.pbr((0.9, 0.6, 0.3), 0.0, 0.5),
        fastibl.Material.pbr((0.2, 0.5, 0.9), 0.0, 0.3, ior=2.4, specular=0.8, specular_color=(1, 0.5, 0.2)),
        fastibl.Material.pbr((0.9, 0.8, 0.7), 1.0, 0.3, anisotropy=0.6, anisotropy_rotation=0.5),
        full_material(),
        full_material(0.5),
    ],
    ids=["metal", "dielectric", "coloured", "brushed", "textures", "brushed textures"],
)
def test_gl_looks_like_the_cpu(material, glossy, marked):
    cpu = layer_of(sphere(), material, marked, methods={"glossy": glossy})
    gl = layer_of(sphere(), material, marked, methods={"glossy": glossy}, backend="gl")
    np.testing.assert_array_equal(cpu[..., 3], gl[..., 3])
    difference = np.abs(cpu - gl)[..., :3] / cpu[..., :3].mean()
    print(f"GL against CPU: mean {difference.mean():.1e}, worst {difference.max():.1e} of the mean")
    # Half floats hold textures to 5e-4, and drivers blend texels in steps of 1/256.
    assert difference.mean() < 2e-3 and np.quantile(difference, 0.999) < 0.03


@needs_gl
def test_gl_follows_a_change_of_material(marked):
    scene = fastibl.Scene(sphere(), full_material(), spheres=0, visibility_rays=0)
    session = fastibl.Session(scene, fastibl.Rig(CAMERA), environment=marked, backend="gl")
    materials = [full_material(), fastibl.Material(), full_material(0.5), fastibl.Material.pbr(np.ones((3, 5, 3))),
                 fastibl.Material(glossy=(0.5, 0.5, 0.5)), full_material()]  # fmt: skip
    seen = []
    for k, material in enumerate(materials):
        session.set_material(material)
        session.process(fastibl.Frame(float(k), back_from_marker=POSE))
        seen.append(session.object.rgba.copy())
        assert session.plan is not None
    np.testing.assert_array_equal(seen[0], seen[-1])
    for a, b in zip(seen, seen[1:], strict=False):
        assert np.abs(a - b).max() > 0.01


# --- files


def write_glb(path, parts):
    """A .glb by trimesh: (mesh, {PBRMaterial's arguments}) each."""
    trimesh = pytest.importorskip("trimesh")
    scene = trimesh.Scene()
    for k, (mesh, material) in enumerate(parts):
        visual = trimesh.visual.TextureVisuals(mesh.uvs, material=trimesh.visual.material.PBRMaterial(**material))
        scene.add_geometry(
            trimesh.Trimesh(mesh.vertices, mesh.triangles, vertex_normals=mesh.normals, visual=visual, process=False),
            geom_name=f"part {k}",
        )
    path.write_bytes(scene.export(file_type="glb", include_normals=True))
    return path


def picture(array):
    return pytest.importorskip("PIL.Image").fromarray(np.asarray(array, np.uint8))


def test_read_object(tmp_path):
    rng = np.random.default_rng(8)
    colour, orm = rng.integers(0, 256, (16, 16, 3)), rng.integers(0, 256, (8, 8, 3))
    path = write_glb(tmp_path / "one.glb", [(sphere(12), dict(
        baseColorTexture=picture(colour), metallicRoughnessTexture=picture(orm), baseColorFactor=[255, 128, 255, 255],
        metallicFactor=0.5, roughnessFactor=1.0, emissiveFactor=[0.1, 0.2, 0.3]))])  # fmt: skip
    mesh, material = fastibl.read_object(path, up="z")
    order = np.lexsort(mesh.vertices.T), np.lexsort(sphere(12).vertices.T)
    np.testing.assert_allclose(mesh.vertices[order[0]], sphere(12).vertices[order[1]], atol=1e-6)
    assert (
        len(mesh.triangles) == len(sphere(12).triangles) and (mesh.uvs >= -1e-6).all() and (mesh.uvs <= 1.000001).all()
    )
    # Where each vertex lies on the texture, as it was written.
    expected = {tuple(np.round(p, 5)): uv for p, uv in zip(sphere(12).vertices, sphere(12).uvs, strict=True)}
    side = (np.abs(sphere(12).normals[:, 2]) < 0.9) & (sphere(12).uvs[:, 0] > 0.01) & (sphere(12).uvs[:, 0] < 0.99)
    found = {tuple(np.round(p, 5)): uv for p, uv in zip(mesh.vertices, mesh.uvs, strict=True)}
    for p in sphere(12).vertices[side]:
        np.testing.assert_allclose(found[tuple(np.round(p, 5))], expected[tuple(np.round(p, 5))], atol=1e-5)
    linear = np.where(colour / 255 <= 0.04045, colour / 255 / 12.92, ((colour / 255 + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(material.base_color, linear * [1, 128 / 255, 1], atol=1e-3)
    np.testing.assert_allclose(material.roughness, orm[..., 1] / 255, atol=1e-3)
    np.testing.assert_allclose(material.metallic, orm[..., 2] / 255 * 0.5, atol=1e-3)
    np.testing.assert_allclose(material.emission, (0.1, 0.2, 0.3), atol=1e-6)
    turned, _ = fastibl.read_object(path)
    np.testing.assert_allclose(turned.vertices, mesh.vertices[:, [0, 2, 1]] * [1, -1, 1], atol=1e-6)
    np.testing.assert_allclose(turned.normals, mesh.normals[:, [0, 2, 1]] * [1, -1, 1], atol=1e-5)
    assert len(fastibl.read_mesh(path).triangles) == len(mesh.triangles)
    fastibl.Scene(fastibl.stand(turned, 0.1), material, spheres=0, visibility_rays=0)


def test_several_materials_become_an_atlas(tmp_path):
    """Each part of the merged object looks as it does alone."""
    rng = np.random.default_rng(9)
    source = fastibl.CubeMap(rng.uniform(0.2, 2, (6, 16, 16, 3)).astype(np.float32))
    shift = lambda m, x: fastibl.Mesh(m.vertices + [x, 0, 0], m.triangles, m.uvs, m.normals)  # noqa: E731
    y, x = np.mgrid[:64, :64] / 64 * 6
    soft = np.stack([np.sin(x), np.cos(y), np.sin(x + y)], axis=-1) * 90 + 128
    parts = [
        (shift(square(0.03), -0.065), dict(baseColorTexture=picture(soft), metallicFactor=0.0, roughnessFactor=0.6)),
        (square(0.03), dict(baseColorFactor=[255, 180, 90, 255], metallicFactor=1.0, roughnessFactor=0.3)),
        (shift(square(0.03), 0.065), dict(baseColorFactor=[20, 90, 30, 255], metallicFactor=0.0, roughnessFactor=0.9,
                                          emissiveFactor=[0.2, 0.0, 0.1])),
    ]  # fmt: skip
    mesh, material = fastibl.read_object(write_glb(tmp_path / "three.glb", parts), up="z")
    assert np.ndim(material.base_color) == 3 and mesh.uvs.min() >= 0 and mesh.uvs.max() <= 1
    seen = layer_of(mesh, material, source, FROM_ABOVE, ABOVE)
    for k, part in enumerate(parts):
        one, its = fastibl.read_object(write_glb(tmp_path / f"{k}.glb", [part]), up="z")
        alone = layer_of(one, its, source, FROM_ABOVE, ABOVE)
        inside = alone[..., 3] == 1
        inside &= np.roll(inside, 1, 0) & np.roll(inside, -1, 0) & np.roll(inside, 1, 1) & np.roll(inside, -1, 1)
        error = np.abs(seen - alone)[inside][:, :3].mean() / alone[inside][:, :3].mean()
        print(f"part {k}: atlas against alone {100 * error:.2f} %")
        assert inside.sum() > 100 and error < 0.03


def test_gltf_of_text_with_nodes(tmp_path):
    """A .gltf with its buffer beside it, interleaved vertices, a mirroring node and no normals: flat triangles."""
    corners = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], np.float32)
    data = np.hstack([corners, corners[:, :2]]).astype("<f4").tobytes() + np.uint16([0, 1, 2, 0, 2, 3]).tobytes()
    (tmp_path / "the data.bin").write_bytes(data)
    header = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"children": [1], "translation": [0, 0, 2]}, {"mesh": 0, "scale": [-1, 2, 1]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}]}],
        "materials": [{
            "pbrMetallicRoughness": {"roughnessFactor": 0.4},
            "extensions": {"KHR_materials_anisotropy": {"anisotropyStrength": 0.6, "anisotropyRotation": 1.0}},
        }],
        "buffers": [{"uri": "the%20data.bin", "byteLength": len(data)}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 80, "byteStride": 20}, {"buffer": 0, "byteOffset": 80, "byteLength": 12},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 0, "byteOffset": 12, "componentType": 5126, "count": 4, "type": "VEC2"},
            {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
    }  # fmt: skip
    path = tmp_path / "square.gltf"
    path.write_text(json.dumps(header))
    mesh, material = fastibl.read_object(path, up="z")
    corners = corners[[2, 1, 0, 3, 2, 0]]  # mirrored: the other way round
    np.testing.assert_allclose(mesh.vertices, corners * [-1, 2, 1] + [0, 0, 2])
    np.testing.assert_allclose(mesh.normals, np.broadcast_to([0, 0, 1], (6, 3)), atol=1e-6)
    np.testing.assert_allclose(mesh.uvs, corners[:, :2] * [1, -1] + [0, 1])
    assert material.roughness == pytest.approx(0.4) and material.metallic == 1
    assert material.anisotropy == pytest.approx(0.6) and material.anisotropy_rotation == pytest.approx(1.0)
    for change, word in (
        ({"extensionsRequired": ["KHR_draco_mesh_compression"]}, "KHR_draco_mesh_compression"),
        ({"asset": {"version": "1.0"}}, "version 1.0"),
        ({"accessors": []}, "damaged"),
        ({"scenes": [{"nodes": []}]}, "no triangles"),
        ({"nodes": [{"children": [0]}]}, "ring"),
        ({"buffers": [{"uri": "missing.bin", "byteLength": 3}]}, "missing.bin"),
    ):
        path.write_text(json.dumps(header | change))
        same_error(lambda: fastibl.read_object(path), ValueError, word, str(path))
    path.write_text("{")
    same_error(lambda: fastibl.read_object(path), ValueError, str(path))
    same_error(lambda: fastibl.read_object(tmp_path / "none.glb"), FileNotFoundError, "none.glb")
    (tmp_path / "mesh.stl").write_text("solid a")
    same_error(lambda: fastibl.read_object(tmp_path / "mesh.stl"), ValueError, "read_mesh")


# --- the true renderer


@pytest.mark.parametrize("name", ["dielectric", "coloured", "brushed", "textures"])
def test_the_true_renderer_agrees(name):
    """The colour of a ball by brute force over the map, with the Fresnel term inside the lobe's integral."""
    from fastibl.truth import TrueRenderer

    material = {
        "dielectric": fastibl.Material.pbr((0.6, 0.4, 0.2), 0.0, 0.6),
        "coloured": fastibl.Material.pbr((0.6, 0.4, 0.2), 0.0, 0.6, ior=2.2, specular=0.7, specular_color=(1, 0.5, 2)),
        "brushed": fastibl.Material.pbr((0.9, 0.8, 0.7), 1.0, 0.5, anisotropy=0.5, anisotropy_rotation=0.3),
        "textures": full_material(),
    }[name]
    d = fastibl.texel_directions(32)
    source = fastibl.CubeMap(1 + 0.6 * np.stack([d[..., 0], d[..., 1] * d[..., 2], -d[..., 2]], axis=-1))
    camera = camera_of(64, 48, 26.0)
    scene = fastibl.Scene(sphere(24), material, spheres=0)
    back = np.zeros((48, 64, 3), np.uint8)
    true = TrueRenderer(scene, grid=8, bounce=False).render(back, 1.0, camera, POSE, source)
    ours = layer_of(sphere(24), material, source, camera)
    inside = (true.coverage == 1) & (ours[..., 3] == 1)
    difference = np.abs(ours[inside, :3] - true.linear[inside])
    print(f"{name}: mean difference {100 * difference.mean() / true.linear[inside].mean():.2f} %")
    # The truth's colour is that of one ray a pixel: blocks of texture are filtered in ours alone.
    limit = 0.06 if name == "textures" else 0.03
    assert inside.sum() > 500 and difference.mean() < limit * true.linear[inside].mean()


@functools.cache
def figurine_of(exponent):
    """A figurine that reflects 0.6: None: diffuse; else glossy, by that exponent."""
    material = (
        fastibl.Material(diffuse=(0.6,) * 3)
        if exponent is None
        else fastibl.Material(diffuse=(0,) * 3, glossy=(0.6,) * 3, exponent=exponent)
    )
    return scene_of(fastibl.shapes.figurine(0.1), material)


@pytest.mark.parametrize("backend", ["cpu", pytest.param("gl", marks=needs_gl)])
@pytest.mark.parametrize(
    "methods", [{"self_shadow": "ambient-occlusion", "glossy": "centroid"}, {"self_shadow": "transfer"}, {}]
)
def test_exponent_0_is_diffuse_light(backend, methods, marked):
    """Self-shadow and bounce included; and what lies between it and exponent 1 goes there."""
    pictures = []
    for exponent in (None, 0.0, 1e-6):
        for bounce in {None: ("none", "one-bounce"), 0: ("one-bounce",), 1e-6: ("none",)}[exponent]:
            session = fastibl.Session(
                figurine_of(exponent),
                fastibl.Rig(CAMERA),
                environment=marked,
                methods={"diffuse": "irradiance-cube", **methods, "bounce": bounce},
                backend=backend,
            )
            session.process(fastibl.Frame(0.0, back_from_marker=POSE))
            pictures.append(session.object.rgba.astype(float))
    plain, bounced, zero, nearly = pictures
    print(f"exponent 0: {np.abs(zero - bounced).max():.1e}, 1e-6: {np.abs(nearly - plain).max():.1e}")
    assert np.abs(plain - bounced).max() > 0.01
    assert np.abs(zero - bounced).max() < 2e-5
    if methods:  # else it may be another self-shadow
        assert np.abs(nearly - plain).max() < 2e-5


def test_the_bounce_of_an_emission_texture_is_not_left_out(marked):
    """What a texture glows with counts, not the factor beside it."""
    light = fastibl.CubeMap(1e5 * marked.faces)
    gains = []
    for emission in ((5e5,) * 3, np.full((4, 4, 3), 5e5, np.float32)):
        scene = fastibl.Scene(sphere(), fastibl.Material.pbr((0, 0, 0), 0.0, 0.5, emission=emission))
        session = fastibl.Session(scene, fastibl.Rig(CAMERA), environment=light)
        session.process(fastibl.Frame(0.0, back_from_marker=POSE))
        gains.append(session.plane_gain.image)
    assert gains[0].max() > 1.05
    np.testing.assert_allclose(gains[1], gains[0], rtol=1e-4)


@needs_gl
@pytest.mark.parametrize("glow", [1e-8, 1e5, 1e8])
def test_gl_shows_emission_textures_of_any_strength(glow):
    texture = (glow * np.random.default_rng(1).uniform(0.5, 1, (8, 8, 3))).astype(np.float32)
    material = fastibl.Material.pbr((0, 0, 0), 1.0, 1.0, emission=texture)
    black = fastibl.CubeMap(np.zeros((6, 4, 4, 3), np.float32))
    cpu, gl = (layer_of(square(), material, black, FROM_ABOVE, ABOVE, backend)[..., :3] for backend in ("cpu", "gl"))
    print(f"glow {glow:g}: GL off by {np.abs(gl / cpu - 1).max():.1e}")
    assert np.abs(gl / cpu - 1).max() < 2e-3
