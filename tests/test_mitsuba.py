"""A path tracer that shares nothing with this library renders the same object under the same map."""

import numpy as np
import pytest

import fastibl
from bench.mitsuba_scene import emitter_of, equirect_of
from conftest import MAPS
from fastibl import reference
from views import camera_of, looking, rays_of

mi = pytest.importorskip("mitsuba")

ALBEDO = np.array([0.8, 0.6, 0.4])
CENTRE, RADIUS = np.array([0.0, 0.0, 0.05]), 0.05
EYE = (0.15, -0.25, 0.15)
CAMERA = camera_of(64, 48, 30.0)
POSE = looking(CENTRE - EYE, EYE)


@pytest.fixture(scope="module", autouse=True)
def variant():
    mi.set_variant("scalar_rgb")


def test_orientation_of_the_map(marked):
    emitter = mi.load_dict(emitter_of(marked))
    directions = fastibl.texel_directions(32)[:, 2:30:3, 2:30:3].reshape(-1, 3)
    seen = []
    for d in directions:
        at = mi.SurfaceInteraction3f()
        at.wi = -mi.Vector3f([float(c) for c in d])
        seen.append(np.array(emitter.eval(at)).ravel())
    error = np.abs(np.array(seen) - marked.sample(directions)).mean(axis=1)
    print(f"marked map in Mitsuba: {100 * (error < 0.1).mean():.1f} % of the directions within 0.1")
    assert (error < 0.1).mean() > 0.93  # but on edges


@pytest.mark.parametrize("up", ["y", "z"])
def test_the_turn_that_the_page_on_files_names(tmp_path, up):
    """A written picture, as Mitsuba reads it with the to_world of docs/files.md."""
    pytest.importorskip("OpenEXR", reason="pip install OpenEXR")
    faces = np.random.default_rng(0).uniform(0.1, 1, (6, 2, 2, 3)).repeat(16, axis=1).repeat(16, axis=2)
    cube = fastibl.CubeMap(faces)
    fastibl.write_environment(tmp_path / "room.exr", cube, axes="gltf", height=128)
    turn = mi.ScalarTransform4f().rotate([0, 1, 0], 90)
    if up == "z":
        turn = mi.ScalarTransform4f().rotate([1, 0, 0], 90) @ turn
    emitter = mi.load_dict({"type": "envmap", "filename": str(tmp_path / "room.exr"), "to_world": turn})
    directions = fastibl.texel_directions(32)[:, 1::3, 1::3].reshape(-1, 3).astype(float)
    seen = []
    for x, y, z in directions:
        at = mi.SurfaceInteraction3f()
        at.wi = -mi.Vector3f([x, z, -y] if up == "y" else [x, y, z])
        seen.append(np.array(emitter.eval(at)).ravel())
    off = np.abs(np.array(seen) - cube.sample(directions)).max(axis=1)
    print(f"{100 * (off < 0.02).mean():.1f} % of the directions within 0.02")
    assert (off < 0.02).mean() > 0.8  # but on edges


def rendered(cube, samples):
    transform = mi.ScalarTransform4f()
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 2, "hide_emitters": True},
            "sensor": {
                "type": "perspective",
                "fov": 30.0,
                "fov_axis": "x",
                "to_world": transform.look_at(origin=list(EYE), target=CENTRE.tolist(), up=[0, 0, 1]),
                "film": {
                    "type": "hdrfilm",
                    "width": CAMERA.width,
                    "height": CAMERA.height,
                    "rfilter": {"type": "box"},
                    "pixel_format": "rgb",
                },
                "sampler": {"type": "multijitter", "sample_count": samples},
            },
            "emitter": emitter_of(cube),
            "ball": {
                "type": "sphere",
                "center": CENTRE.tolist(),
                "radius": RADIUS,
                "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": ALBEDO.tolist()}},
            },
        }
    )
    return np.array(mi.render(scene), np.float64)


@pytest.mark.parametrize("place", ["real", "generated"])
def test_a_diffuse_ball_looks_the_same(place, marked):
    if place == "real":
        if not MAPS:
            pytest.skip("no real HDR maps beside the project")
        cube = fastibl.read_environment(MAPS[0], size=64)
    else:
        cube = marked
    theirs = rendered(cube, 1024)

    # Pixels that see the ball alone, and the normal in the middle of each.
    offset = np.asarray(EYE) - CENTRE
    fine = rays_of(CAMERA, POSE, split=4)
    hit = ((fine @ offset) ** 2 - offset @ offset + RADIUS**2 > 0) & (fine @ offset < 0)
    inside = hit.reshape(48, 4, 64, 4).all(axis=(1, 3))
    along = (fine @ offset)[hit]
    normals = np.zeros(fine.shape)
    normals[hit] = offset + (-along - np.sqrt(along**2 - offset @ offset + RADIUS**2))[:, None] * fine[hit]
    normals = normals.reshape(48, 4, 64, 4, 3).mean(axis=(1, 3))[inside]
    truth = reference.irradiance(equirect_of(cube, 192), normals) * ALBEDO / np.pi
    difference = np.abs(theirs[inside] - truth).mean() / truth.mean()
    bias = (theirs[inside].mean(axis=0) / truth.mean(axis=0) - 1) * 100
    print(f"{place}: Mitsuba against the sum over the map {100 * difference:.2f} %, bias {bias.round(2)} %")
    assert inside.sum() > 300 and difference < 0.01

    import trimesh

    mesh = trimesh.creation.icosphere(5, RADIUS)
    scene = fastibl.Scene(
        fastibl.Mesh(mesh.vertices + CENTRE, mesh.faces), fastibl.Material(diffuse=ALBEDO), spheres=0, visibility_rays=0
    )
    for method in ("sh9", "six-face"):
        session = fastibl.Session(scene, fastibl.Rig(CAMERA), environment=cube, methods={"diffuse": method})
        session.process(fastibl.Frame(0.0, back_from_marker=POSE))
        layer, ours = session.object, np.zeros((48, 64, 4))
        h, w = layer.rgba.shape[:2]
        ours[layer.y : layer.y + h, layer.x : layer.x + w] = layer.rgba
        assert (ours[inside, 3] == 1).mean() > 0.99
        error = np.abs(ours[inside, :3] - theirs[inside]).mean() / truth.mean()
        told = session.process(fastibl.Frame(0.1, back_from_marker=POSE)).predicted_error
        print(f"{place}: {method} against Mitsuba {100 * error:.2f} % (the map's own error by it: {100 * told:.2f} %)")
        assert error < 2 * told + 0.01


@pytest.mark.parametrize("alpha", [(0.15, 0.15), (0.1, 0.4)])
def test_a_rough_metal_ball_looks_the_same(alpha):
    """Mitsuba's roughconductor without colour: single scattering of GGX with Fresnel 1, on a ball brushed around z."""
    if not MAPS:
        pytest.skip("no real HDR maps beside the project")
    cube = fastibl.read_environment(MAPS[0], size=64)
    # Directions towards the eye on rays through the middles of pixels well inside the ball.
    rays = rays_of(CAMERA, POSE).reshape(-1, 3)
    offset = np.asarray(EYE) - CENTRE
    along = rays @ offset
    inside = along**2 - offset @ offset + (0.85 * RADIUS) ** 2 > 0
    chosen = np.flatnonzero(inside)[::23]
    t = -along - np.sqrt(np.maximum(along**2 - offset @ offset + RADIUS**2, 0))
    normals = (offset + t[:, None] * rays)[chosen] / RADIUS
    views = -rays[chosen]
    tangents = np.cross([0.0, 0, 1], normals)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)

    # Their reflection: an average over their own samples of the half vector, in their own frame of the surface.
    bsdf = mi.load_dict({"type": "roughconductor", "material": "none", "distribution": "ggx",
                         "alpha_u": alpha[0], "alpha_v": alpha[1]})  # fmt: skip
    rng, count = np.random.default_rng(0), 3000
    context, theirs = mi.BSDFContext(), np.zeros((len(chosen), 3))
    for i, (n, v, u) in enumerate(zip(normals, views, tangents, strict=True)):
        frame = np.stack([u, np.cross(n, u), n])
        at = mi.SurfaceInteraction3f()
        at.wi = mi.Vector3f([float(c) for c in frame @ v])
        towards, weights = [], []
        for a, b, c in rng.random((count, 3)):
            sample, weight = bsdf.sample(context, at, float(a), mi.Point2f(float(b), float(c)))
            towards.append(np.array(sample.wo).ravel())
            weights.append(np.array(weight).ravel())
        # A sample below the horizon has no weight.
        light = cube.sample(np.array(towards) @ frame)
        theirs[i] = (np.array(weights) * np.where(np.array(weights) > 0, light, 0)).mean(axis=0)
    truth = reference.ggx(cube, normals, views, tangents=tangents, alpha=alpha, normalization="single")
    oracle = np.abs(theirs - truth).mean() / truth.mean()
    lighting = fastibl.Lighting(cube)
    ours = lighting.ggx(normals, views, tangents=tangents, alpha=np.array(alpha), normalization="single")
    error = np.abs(ours - theirs).mean() / truth.mean()
    bias = (theirs.mean() / truth.mean() - 1) * 100
    print(f"alpha {alpha}, {len(chosen)} points: oracle against Mitsuba {100 * oracle:.2f} %, bias {bias:.2f} %")
    print(f"alpha {alpha}: ours against Mitsuba {100 * error:.2f} %")  # both with its noise
    assert len(chosen) > 20 and oracle < 0.06 and abs(bias) < 2 and error < 0.1
