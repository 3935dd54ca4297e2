"""fastibl measures the light of a place with ordinary cameras and lights virtual objects with it, live.

Frames, units and pixel conventions are stated once, in docs/conventions.md.
"""

from . import reference
from ._fastibl import (
    Bvh,
    Camera,
    CubeMap,
    Environment,
    Material,
    Mesh,
    Pose,
    Response,
    Rig,
    ShadowMap,
    __version__,
    ambient_occlusion,
    cast_shadow,
    cubemap_from_equirect,
    equirect_from_cubemap,
    fit_spheres,
    set_threads,
    shadow_ratio,
    texel_directions,
    texel_solid_angles,
    threads,
)
from .files import read_environment, read_mesh, stand

__all__ = [
    "Bvh",
    "Camera",
    "CubeMap",
    "Environment",
    "Material",
    "Mesh",
    "Pose",
    "Response",
    "Rig",
    "ShadowMap",
    "__version__",
    "ambient_occlusion",
    "cast_shadow",
    "cubemap_from_equirect",
    "equirect_from_cubemap",
    "fit_spheres",
    "read_environment",
    "read_mesh",
    "reference",
    "set_threads",
    "shadow_ratio",
    "stand",
    "texel_directions",
    "texel_solid_angles",
    "threads",
]
