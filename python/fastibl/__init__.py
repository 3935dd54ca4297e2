"""fastibl measures the light of a place with ordinary cameras and lights virtual objects with it, live.

Frames, units and pixel conventions are stated once, in docs/conventions.md.
"""

from . import reference, shapes
from ._fastibl import (
    Bounce,
    Bvh,
    Camera,
    Capture,
    CubeMap,
    DetectedTag,
    DirectionShadow,
    Environment,
    FrameResult,
    MainLight,
    Material,
    Mesh,
    ObjectLayer,
    PictureLayers,
    Plan,
    PlaneExchange,
    PlannedPass,
    Pose,
    Response,
    Rig,
    Scene,
    SelfShadow,
    ShadowMap,
    Tag,
    Taken,
    Tracked,
    Turned,
    __version__,
    ambient_occlusion,
    cast_shadow,
    cubemap_from_equirect,
    dfg_table,
    directional_albedo,
    due_passes,
    equirect_from_cubemap,
    fit_spheres,
    ggx_albedo,
    light_directions,
    main_lights,
    set_threads,
    shadow_ratio,
    texel_directions,
    texel_solid_angles,
    threads,
)
from .board import Board
from .comparison import compare
from .costs import default_costs, machine_costs
from .display import attach as _attach
from .display import plot
from .environment_files import read_environment, write_environment
from .export import export_light
from .files import read_mesh, read_object, stand
from .gltf_light import write_gltf_light
from .guidance import Guidance, guide
from .layer_files import write_layers
from .lighting import Lighting, Method, methods, without_lights
from .map_rotation import rotate_map
from .mesh_shadow import MeshShadow
from .recording import Frame, Recording
from .session import Session, make_plan
from .sh_files import write_sh
from .shadow_files import write_shadow
from .tracking import RotationTracker, Tracker
from .usd import write_usd

__all__ = [
    "Board",
    "Bounce",
    "Bvh",
    "Camera",
    "Capture",
    "CubeMap",
    "DetectedTag",
    "Environment",
    "Frame",
    "FrameResult",
    "Guidance",
    "Lighting",
    "MainLight",
    "Material",
    "Mesh",
    "MeshShadow",
    "Method",
    "ObjectLayer",
    "PictureLayers",
    "Plan",
    "PlaneExchange",
    "PlannedPass",
    "Pose",
    "Recording",
    "Response",
    "Rig",
    "RotationTracker",
    "Scene",
    "SelfShadow",
    "Session",
    "DirectionShadow",
    "ShadowMap",
    "Tag",
    "Taken",
    "Tracked",
    "Tracker",
    "Turned",
    "__version__",
    "ambient_occlusion",
    "cast_shadow",
    "compare",
    "cubemap_from_equirect",
    "dfg_table",
    "directional_albedo",
    "default_costs",
    "due_passes",
    "equirect_from_cubemap",
    "export_light",
    "fit_spheres",
    "guide",
    "light_directions",
    "ggx_albedo",
    "main_lights",
    "machine_costs",
    "make_plan",
    "methods",
    "plot",
    "read_environment",
    "read_mesh",
    "read_object",
    "reference",
    "rotate_map",
    "set_threads",
    "shadow_ratio",
    "shapes",
    "simulate",
    "stand",
    "texel_directions",
    "texel_solid_angles",
    "threads",
    "without_lights",
    "write_environment",
    "write_gltf_light",
    "write_layers",
    "write_sh",
    "write_shadow",
    "write_usd",
]


_attach()

# Imported only when they are asked for, because they import OpenCV or other large packages.
_MODULES = (
    "batch", "calibration", "display", "exposure", "faults", "guidance", "gyroscope", "live", "measuring",
    "photographs", "recorder", "recording", "report", "sources", "truth", "white",
)  # fmt: skip


def __getattr__(name: str):
    if name in _MODULES:
        from importlib import import_module

        return import_module(f".{name}", __name__)
    if name == "simulate":
        from .simulator import simulate

        return simulate
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*__all__, *_MODULES})
