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
    __version__,
    cubemap_from_equirect,
    directional_albedo,
    equirect_from_cubemap,
    set_threads,
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
    "__version__",
    "cubemap_from_equirect",
    "directional_albedo",
    "equirect_from_cubemap",
    "methods",
    "read_environment",
    "read_mesh",
    "reference",
    "set_threads",
    "stand",
    "texel_directions",
    "texel_solid_angles",
    "threads",
]
