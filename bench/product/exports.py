"""What other programs read from exported light: irradiance and orientation, each by a reader that is not ours."""

from __future__ import annotations

import itertools
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl import reference
from fastibl.axes import handed, to_axes
from fastibl.dds import write_dds
from fastibl.expected import present
from fastibl.room import Room

from ..goals import Goal, percent, row, skipped
from ..inputs import real_maps
from . import readers

_GLTF = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])  # takes the marker frame to glTF's axes
_TURNS = np.array([
    np.diag(signs)[list(order)]
    for order in itertools.permutations(range(3))
    for signs in itertools.product((1, -1), repeat=3)
])  # fmt: skip
_WITHIN = 0.005
Samples = tuple[NDArray, NDArray, NDArray]  # directions in glTF's axes, solid angles, radiances


def _normals() -> NDArray:
    """(480, 3) in glTF's axes: ten directions in each of the 48 turns and mirrorings of the axes."""
    n = np.random.default_rng(0).normal(size=(10, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    return (_TURNS @ n.T).transpose(0, 2, 1).reshape(-1, 3)


def _irradiance(samples: Samples, normals: NDArray) -> NDArray:
    directions, angles, radiance = samples
    return np.maximum(normals @ directions.T, 0) @ (angles[:, None] * radiance)


def _basis(n: NDArray) -> NDArray:
    """Real orthonormal harmonics to the second order, times the clamped cosine's factors."""
    x, y, z = n.T
    third = [0.488603 * v * 2 * np.pi / 3 for v in (y, z, x)]
    fifth = [
        1.092548 * x * y,
        1.092548 * y * z,
        0.315392 * (3 * z * z - 1),
        1.092548 * x * z,
        0.546274 * (x * x - y * y),
    ]
    return np.stack([0.282095 * np.pi + 0 * x, *third, *(v * np.pi / 4 for v in fifth)], axis=-1)


def _nine(samples: Samples, normals: NDArray) -> NDArray:
    """Irradiance from the nine harmonics of a map, which is all that files of nine coefficients can hold."""
    directions, angles, radiance = samples
    cosine = np.array([np.pi] + [2 * np.pi / 3] * 3 + [np.pi / 4] * 5)
    return _basis(normals) @ ((_basis(directions) / cosine).T @ (angles[:, None] * radiance))


def _compared(read: NDArray, true: NDArray) -> tuple[float, float]:
    """How far the irradiance at `_normals` is from the truth, and how far it is in the best of the 47 other turns."""
    read, true = (e.reshape(48, 10, 3) for e in (read, true))
    index = {turn.tobytes(): k for k, turn in enumerate(_TURNS)}
    off = [
        np.abs(read[[index[(turn @ other).tobytes()] for other in _TURNS]] - true).mean() / true.mean()
        for turn in _TURNS
    ]
    right = index[np.eye(3, dtype=_TURNS.dtype).tobytes()]
    return float(off[right]), float(min(off[:right] + off[right + 1 :]))


def _goal(what: str, read: dict[str, tuple[NDArray, NDArray]], *notes: str) -> Goal:
    """read: for each map, the irradiance as read and as it should be."""
    found = {name: _compared(*pair) for name, pair in read.items()}
    off, others = max(v[0] for v in found.values()), min(v[1] for v in found.values())
    right = all(own < 0.2 * other for own, other in found.values())
    return Goal(
        what,
        f"{percent(off, 2)}; orientation {'right' if right else 'WRONG'} (next of 47: {percent(others, 2)})",
        "≤ 0.5 %, right",
        off <= _WITHIN and right,
        ("by map: " + ", ".join(f"{name} {percent(own, 2)}" for name, (own, _) in found.items()), *notes),
    )


def _maps() -> dict[str, fastibl.CubeMap]:
    real = real_maps()
    return {"room": Room().truth(size=128)} | {k: real[k] for k in ("venice_sunset", "studio_small_03") if k in real}


@row("product", "exports")
def exports() -> Iterator[Goal]:
    maps, normals = _maps(), _normals()
    source = {name: reference.samples(cube) for name, cube in maps.items()}
    source = {name: (d @ _GLTF.T, w, radiance) for name, (d, w, radiance) in source.items()}
    true = {name: _irradiance(samples, normals) for name, samples in source.items()}
    nine = {name: _nine(samples, normals) for name, samples in source.items()}
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        for name, cube in maps.items():
            _export(cube, root / name)
        yield from _by_usd(root, true, normals)
        yield from _by_cmgen(root, nine, normals)
        cut = {name: _irradiance((d, w, np.minimum(v, 255)), normals) for name, (d, w, v) in source.items()}
        yield from _by_web(root, true, cut, nine, normals)
        yield from _shadows(root, maps["room"])


def _export(cube: fastibl.CubeMap, folder: Path) -> None:
    fastibl.export_light(cube, folder, format="ktx2", size=128, sh=("filament", "three.js"), gltf=True)
    fastibl.export_light(cube, folder, format="exr", size=32, usd=True)
    fastibl.write_environment(folder / "environment.hdr", cube, axes="gltf")
    fastibl.write_environment(folder / "cross.exr", cube, "cross", axes="gltf")
    levels = fastibl.Lighting(to_axes(cube, "gltf")).prefiltered(128, 8)
    write_dds(folder / "environment.dds", [handed(present(level), "left").faces for level in levels])


def _by_usd(root: Path, true: dict[str, NDArray], normals: NDArray) -> Iterator[Goal]:
    what = "light.usda + .exr: OpenUSD (usd-core), picture by Mitsuba"
    try:
        import mitsuba
        from pxr import Usd, UsdGeom, UsdLux
    except ImportError as error:
        yield skipped(what, f"needs usd-core and mitsuba: {error}")
        return
    mitsuba.set_variant("scalar_rgb")
    pictures = {name: np.array(mitsuba.Bitmap(str(root / name / "environment.hdr")), np.float64) for name in true}
    three = {name: _irradiance(_turned(_latlong(picture[..., :3])), normals) for name, picture in pictures.items()}
    yield _goal(".hdr: Mitsuba", {name: (three[name], true[name]) for name in true})
    read = {}
    for name in true:
        stage = Usd.Stage.Open(str(root / name / "light.usda"))
        (prim,) = (p for p in stage.Traverse() if p.IsA(UsdLux.DomeLight))
        light = UsdLux.DomeLight(prim)
        turn = np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(Usd.TimeCode.Default()))[:3, :3]
        picture = np.array(mitsuba.Bitmap(light.GetTextureFileAttr().Get().resolvedPath), np.float64)[..., :3]
        samples = _latlong(picture * light.GetIntensityAttr().Get() * 2.0 ** light.GetExposureAttr().Get())
        read[name] = (_irradiance((samples[0] @ turn, *samples[1:]), normals), true[name])
    yield _goal(what, read)


def _latlong(picture: NDArray) -> Samples:
    """OpenEXR's latitude-longitude map: +z in the middle, +x to the left of it, +y at the top."""
    height, width = picture.shape[:2]
    latitude = np.pi / 2 - (np.arange(height) + 0.5) / height * np.pi
    longitude = np.pi - (np.arange(width) + 0.5) / width * 2 * np.pi
    directions = np.stack(
        [np.cos(latitude)[:, None] * np.sin(longitude), np.sin(latitude)[:, None] + 0 * longitude,
         np.cos(latitude)[:, None] * np.cos(longitude)], axis=-1,
    )  # fmt: skip
    edges = np.sin(np.linspace(np.pi / 2, -np.pi / 2, height + 1))
    angles = np.repeat((edges[:-1] - edges[1:]) * 2 * np.pi / width, width)
    return directions.reshape(-1, 3), angles, picture.reshape(-1, 3)


def _turned(samples: Samples) -> Samples:
    """From OpenEXR's frame, with +z in the middle and +x to its left, to one with +x in the middle and +z to its
    right."""
    x, y, z = samples[0].T
    return np.stack([z, y, -x], axis=-1), *samples[1:]


def _rows(path: Path) -> NDArray:
    """The nine rows of an sh.txt, (9, 3)."""
    return np.array(
        [[float(v) for v in line[1 : line.index(")")].split(",")] for line in path.read_text().splitlines()]
    )


def _by_cmgen(root: Path, nine: dict[str, NDArray], normals: NDArray) -> Iterator[Goal]:
    what = "cross.exr, sh.txt: what Filament's cmgen makes of the cross"
    if shutil.which("cmgen") is None:
        yield skipped(what, "needs cmgen (Debian: libfilament-tools)")
        return
    shader = _shader(normals)
    read, against = {}, {}
    for name in nine:
        folder = root / name
        command = "cmgen -q --deploy=cmgen --format=hdr --size=128 --ibl-samples=1 --sh-window=no --no-mirror cross.exr"
        subprocess.run(command.split(), cwd=folder, check=True, capture_output=True)
        theirs = shader @ _rows(folder / "cmgen" / "cross" / "sh.txt")
        read[name] = (theirs, shader @ _rows(folder / "sh.txt"))
        against[name] = (shader @ _rows(folder / "sh.txt"), nine[name])
    yield _goal(what, read, "of the nine harmonics; cmgen reads a cross, which it takes as it is with --no-mirror")
    yield _goal("sh.txt: by Filament's shader, against the map's nine harmonics", against)


def _by_web(
    root: Path, true: dict[str, NDArray], cut: dict[str, NDArray], nine: dict[str, NDArray], normals: NDArray
) -> Iterator[Goal]:
    why = readers.missing()
    if why:
        yield skipped("three.js, Babylon.js, ktx-parse, glTF validator", why)
        return
    try:
        packages = readers.install()
    except RuntimeError as error:
        yield skipped("three.js, Babylon.js, ktx-parse, glTF validator", str(error))
        return

    def named(*endings: str) -> list[Path]:
        made = []
        for name, ending in itertools.product(true, endings):
            source = "light.glb" if ending == "glb" else f"environment.{ending}"
            made.append(Path(shutil.copy(root / name / source, root / f"{name}.{ending}")))
        return made

    three = readers.in_browser(packages, "three.html", named("hdr", "exr", "ktx2"))
    babylon = readers.in_browser(packages, "babylon.html", named("glb", "dds"))
    for ending, loader in (("hdr", "HDRLoader"), ("exr", "EXRLoader"), ("ktx2", "its ktx-parse, CubeTexture")):
        seen = {n: _seen(three[f"{n}.{ending}"], normals) for n in true}
        yield _goal(f".{ending}: three.js, {loader}, as background", {n: (seen[n], true[n]) for n in true})
    seen = {n: _seen(babylon[f"{n}.glb"], normals) for n in true}
    yield _goal("light.glb: Babylon.js, specular images (RGBD, to 255)", {n: (seen[n], cut[n]) for n in true})
    even = {n: _shader(normals * [-1, 1, 1]) @ np.array(babylon[f"{n}.glb"]["harmonics"]) for n in true}
    yield _goal("light.glb: Babylon.js, irradiance of the harmonics", {n: (even[n], nine[n]) for n in true})

    seen = {n: _seen(babylon[f"{n}.dds"], normals) for n in true}
    ours = {n: _as_we_read(root / f"{n}.dds", normals) for n in true}
    yield _goal("reading .dds: as Babylon.js shows the same file", {n: (ours[n], seen[n]) for n in true})

    node = {name: readers.in_node(packages, root / name, normals) for name in true}
    probe = {n: (np.array(found["irradiance"]), nine[n]) for n, found in node.items()}
    yield _goal("probe.json: three.js, ObjectLoader, LightProbe", probe)
    gltf = [found["gltf"] for found in node.values()]
    issues = sum(g["numErrors"] + g["numWarnings"] for g in gltf)
    codes = sorted({m["code"] for g in gltf for m in g["messages"]})
    yield Goal("light.glb: Khronos gltf-validator", f"{issues} errors and warnings", "0", issues == 0,
               (f"hints: {', '.join(codes)}; it does not know the extension itself",))  # fmt: skip
    texture = node["room"]["texture"]
    expected = {
        "format": 97,
        "faces": 6,
        "size": 128,
        "levels": [48 * (128 >> k) ** 2 for k in range(7)],
        "transfer": 1,
    }
    same = all(texture[key] == value for key, value in expected.items())
    yield Goal(
        "prefiltered.ktx2: Khronos' layout by ktx-parse", "as written" if same else str(texture), "as written", same
    )
    ours = {n: _as_we_read(root / n / "theirs.ktx2", normals) for n in true}
    yield _goal("reading .ktx2 that ktx-parse wrote", {n: (ours[n], true[n]) for n in true})


def _as_we_read(path: Path, normals: NDArray) -> NDArray:
    """Irradiance of a file as `read_environment` reads it, at normals in glTF's axes."""
    return _irradiance(reference.samples(fastibl.read_environment(path, axes="gltf")), normals @ _GLTF)


def _seen(result: dict, normals: NDArray) -> NDArray:
    return _irradiance(readers.view_samples(result["views"]), normals)


def _shader(n: NDArray) -> NDArray:
    """What Filament's and Babylon.js' shaders multiply by pre-scaled harmonics, times pi, because those are divided by
    pi."""
    x, y, z = n.T
    return np.pi * np.stack([x**0, y, z, x, y * x, y * z, 3 * z * z - 1, z * x, x * x - y * y], axis=-1)


def _shadows(root: Path, cube: fastibl.CubeMap) -> Iterator[Goal]:
    """A matte over a white plate, as other programs read it, compared with the ratio of the light."""
    try:
        import mitsuba
        from PIL import Image
    except ImportError as error:
        yield skipped("shadow.exr, shadow.png", f"needs mitsuba and pillow: {error}")
        return
    mesh = fastibl.stand(fastibl.shapes.figurine(), 0.2)
    shadow = fastibl.MeshShadow(mesh, 64, progress=False, cache=False).cast(cube)
    fastibl.write_shadow(root / "shadow.exr", shadow)
    fastibl.write_shadow(root / "shadow.png", shadow)
    layers = {name: np.array(part, np.float64) for name, part in mitsuba.Bitmap(str(root / "shadow.exr")).split()}
    n = len(layers["ratio"])
    across = ((np.arange(n) + 0.5) / n * 2 - 1) * shadow.reach
    x, y = np.meshgrid(across, across[::-1])  # +y at the top
    ratio = shadow.sample(np.stack([x, y], axis=-1)).astype(np.float64)
    grey = ratio @ [0.2126, 0.7152, 0.0722]
    matte = layers["<root>"] if "<root>" in layers else layers["RGBA"]
    png = np.array(Image.open(root / "shadow.png"))
    opacity = png[..., -1] / np.iinfo(png.dtype).max
    for what, off in (
        ("shadow.exr, ratio over the plate: Mitsuba", np.abs(layers["ratio"] - ratio).max()),
        ("shadow.exr, matte over the plate: Mitsuba", np.abs(matte[..., :3].mean(-1) + 1 - matte[..., 3] - grey).max()),
        ("shadow.png, matte over the plate: Pillow (8 bits)", np.abs(1 - opacity - grey).max()),
    ):
        turned = np.abs(grey[::-1] - grey).max()
        yield Goal(
            what, f"{percent(off, 2)} at most (upside down: {percent(turned, 2)})", "≤ 0.5 %", bool(off <= _WITHIN)
        )
