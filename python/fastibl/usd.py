"""OpenUSD files (.usda): a map as a dome light.

The text form is written directly: an optional USD library would take 60 MB for these lines.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ._fastibl import CubeMap, Environment
from .axes import matrix, radiance_of, turned
from .environment_files import write_equirect
from .pictures import LINEAR
from .whole_file import path_ending, write_whole

# A dome's own frame has its pole along +y, whichever axis is up in the stage. Its picture follows OpenEXR: longitude 0,
# in the middle, is +z, and +x is to the left of it. The matrix takes a direction in the dome's frame to the frame of
# our equirectangular pictures (z up, middle along +y, +x to the right).
_PICTURE_FROM_DOME = np.array([[-1, 0, 0], [0, 0, 1], [0, 1, 0]])
_UP = {"gltf": "Y", "marker": "Z"}
AXES = tuple(_UP)
# Takes the stage's frame to the dome's. In a stage with z up, UsdLuxDomeLight.OrientToStageUpAxis adds a rotation that
# turns y to z.
_DOME_FROM_STAGE = {"gltf": np.eye(3, dtype=int), "marker": np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])}
_TO_Z_UP = """
        double xformOp:rotateX:orientToStageUpAxis = 90
        uniform token[] xformOpOrder = ["xformOp:rotateX:orientToStageUpAxis"]"""


def write_usd(
    path: str | os.PathLike[str],
    cube: CubeMap | Environment,
    axes: str = "gltf",
    format: str = "hdr",
    height: int | None = None,
) -> list[Path]:
    """Writes a map as a DomeLight in a .usda file, with its picture beside it (..._dome.hdr); returns both files.

    axes: "gltf", a stage with y up, or "marker", one with z up; in metres. format: "hdr" or "exr". height: of the
    picture, by default 2 face edges. The light's intensity is 1: the picture holds radiance. Raises ValueError for
    other axes, another format or ending, ImportError for .exr without OpenEXR.
    """
    path = path_ending(path, ".usda")
    if f".{format}" not in LINEAR:
        raise ValueError(f'format must be "hdr" or "exr", got {format!r}')
    if axes not in AXES:
        raise ValueError(f"axes must be one of {', '.join(AXES)}, which a stage can have, got {axes!r}")
    stage_from_marker = matrix(axes)
    picture_from_marker = _PICTURE_FROM_DOME @ _DOME_FROM_STAGE[axes] @ stage_from_marker
    radiance = radiance_of(cube)
    picture = path.with_name(f"{path.stem}_dome.{format}")
    write_equirect(picture, turned(radiance, picture_from_marker), height)
    write_whole(path, _stage(picture.name, axes))
    return [path, picture]


def _asset(path: str) -> str:
    """A path in USD's text: between @, or between @@@ where it holds one."""
    escaped = path.replace("@@@", r"\@@@")
    return f"@@@{escaped}@@@" if "@" in path else f"@{path}@"


def _stage(picture: str, axes: str) -> str:
    return f"""#usda 1.0
(
    defaultPrim = "Light"
    metersPerUnit = 1
    upAxis = "{_UP[axes]}"
)

def Xform "Light"
{{
    def DomeLight "Environment"
    {{
        asset inputs:texture:file = {_asset("./" + picture)}
        token inputs:texture:format = "latlong"
        float inputs:intensity = 1
        float inputs:exposure = 0
        color3f inputs:color = (1, 1, 1){_TO_Z_UP if axes == "marker" else ""}
    }}
}}
"""
