"""Maps, cameras and meshes in Mitsuba's form. Needs mitsuba, with its variant set beforehand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import fastibl


def equirect_of(cube: fastibl.CubeMap, height: int, poles: bool = False) -> NDArray[np.float32]:
    """Values of the map at the middles of an equirectangular picture's pixels; with `poles`, the first and last rows
    lie on the poles."""
    u = ((np.arange(2 * (height - poles)) + 0.5) / (2 * (height - poles)) - 0.5) * 2 * np.pi
    v = (np.arange(height) / (height - 1) if poles else (np.arange(height) + 0.5) / height)[:, None] * np.pi
    return cube.sample(np.stack(np.broadcast_arrays(np.sin(v) * np.sin(u), np.sin(v) * np.cos(u), np.cos(v)), axis=-1))


def emitter_of(cube: fastibl.CubeMap) -> dict[str, Any]:
    """A map as Mitsuba's emitter.

    Ours: u = 1/2 + atan2(x, y) / 2 pi, v = acos(z) / pi. Mitsuba's, in its own frame (a, b, c): u = atan2(a, -c) / 2
    pi, v = acos(b) / pi. So (a, b, c) = (-x, z, y). The first and last rows of Mitsuba's picture lie on the poles.
    """
    import mitsuba as mi

    image = equirect_of(cube, 257, poles=True)
    local_from_world = np.array([[-1.0, 0, 0, 0], [0, 0, 1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    return {
        "type": "envmap",
        "bitmap": mi.Bitmap(np.ascontiguousarray(image, np.float32)),
        "to_world": mi.ScalarTransform4f(local_from_world.T),
    }


def sensor_of(camera: fastibl.Camera, camera_from_marker: fastibl.Pose, samples: int) -> dict[str, Any]:
    """A camera without distortion whose axis meets the middle of its picture."""
    import mitsuba as mi

    eye = camera_from_marker.inverse().translation
    towards = camera_from_marker.rotation[2]
    return {
        "type": "perspective",
        "fov": float(np.degrees(2 * np.arctan(camera.width / 2 / camera.fx))),
        "fov_axis": "x",
        "to_world": mi.ScalarTransform4f().look_at(
            origin=eye.tolist(), target=(eye + towards).tolist(), up=[0.0, 0.0, 1.0]
        ),
        "film": {
            "type": "hdrfilm",
            "width": camera.width,
            "height": camera.height,
            "rfilter": {"type": "box"},
            "pixel_format": "rgb",
        },
        "sampler": {"type": "independent", "sample_count": samples},
    }


def shape_of(mesh: fastibl.Mesh, folder: Path, bsdf: dict[str, Any]) -> dict[str, Any]:
    """A mesh with its own normals, passed through a file in `folder`."""
    import trimesh

    path = folder / "mesh.ply"
    trimesh.Trimesh(mesh.vertices, mesh.triangles, vertex_normals=mesh.normals, process=False).export(
        path, vertex_normal=True
    )
    return {"type": "ply", "filename": str(path), "bsdf": bsdf}
