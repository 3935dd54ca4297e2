"""fastibl measures the light of a place with ordinary cameras and lights virtual objects with it, live.

Frames, units and pixel conventions are stated once, in docs/conventions.md.
"""

from . import reference, shapes
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
    __version__,
    cubemap_from_equirect,
    equirect_from_cubemap,
    set_threads,
    texel_directions,
    texel_solid_angles,
    threads,
)
from .files import read_environment, read_mesh, stand
from .recording import Frame, Recording

__all__ = [
    "Bvh",
    "Camera",
    "CubeMap",
    "Environment",
    "Frame",
    "Material",
    "Mesh",
    "Pose",
    "Recording",
    "Response",
    "Rig",
    "__version__",
    "cubemap_from_equirect",
    "equirect_from_cubemap",
    "read_environment",
    "read_mesh",
    "reference",
    "set_threads",
    "shapes",
    "simulate",
    "stand",
    "texel_directions",
    "texel_solid_angles",
    "threads",
]


def __getattr__(name: str):
    if name == "simulate":  # brings OpenCV along, so only when it is asked for
        from .simulator import simulate

        return simulate
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
