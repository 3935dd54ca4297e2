"""fastibl measures the light of a place with ordinary cameras and lights virtual objects with it, live.

Frames, units and pixel conventions are stated once, in docs/conventions.md.
"""

from . import reference
from ._fastibl import (
    Bvh,
    Camera,
    Capture,
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
    directional_albedo,
    equirect_from_cubemap,
    fit_spheres,
    set_threads,
    shadow_ratio,
    texel_directions,
    texel_solid_angles,
    threads,
)
from .files import read_environment, read_mesh, stand
from .lighting import Lighting, Method, methods

__all__ = [
    "Bvh",
    "Camera",
    "Capture",
    "CubeMap",
    "Environment",
    "Lighting",
    "Material",
    "Mesh",
    "Method",
    "Pose",
    "Response",
    "Rig",
    "ShadowMap",
    "__version__",
    "ambient_occlusion",
    "cast_shadow",
    "cubemap_from_equirect",
    "directional_albedo",
    "equirect_from_cubemap",
    "methods",
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
