"""fastibl measures the light of a place with ordinary cameras and lights virtual objects with it, live.

Frames, units and pixel conventions are stated once, in docs/conventions.md.
"""

from . import reference
from ._fastibl import (
    Board,
    Bvh,
    Camera,
    CubeMap,
    DetectedTag,
    Environment,
    Material,
    Mesh,
    Pose,
    Response,
    Rig,
    Tag,
    Tracked,
    __version__,
    cubemap_from_equirect,
    equirect_from_cubemap,
    set_threads,
    texel_directions,
    texel_solid_angles,
    threads,
)
from .files import read_environment, read_mesh, stand
from .tracking import Tracker

__all__ = [
    "Board",
    "Bvh",
    "Camera",
    "CubeMap",
    "DetectedTag",
    "Environment",
    "Material",
    "Mesh",
    "Pose",
    "Response",
    "Rig",
    "Tag",
    "Tracked",
    "Tracker",
    "__version__",
    "cubemap_from_equirect",
    "equirect_from_cubemap",
    "read_environment",
    "read_mesh",
    "reference",
    "set_threads",
    "stand",
    "texel_directions",
    "texel_solid_angles",
    "threads",
]
