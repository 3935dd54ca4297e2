"""The device with which backend="gl" draws on this machine."""

from __future__ import annotations

from functools import cache

import numpy as np

from ._fastibl import Camera, Mesh, Rig, Scene
from .session import Session


@cache
def gl_device() -> tuple[str, str]:
    """The driver's name (GL_RENDERER), and why the GL back end cannot run: one of the two is empty."""
    scene = Scene(Mesh(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]])), spheres=0, visibility_rays=0)
    try:
        return Session(scene, Rig(Camera(8, 8, 8, 8, 4, 4)), backend="gl").device, ""
    except (RuntimeError, ValueError) as error:
        return "", str(error)


def draws_in_software(device: str) -> bool:
    """Whether a driver of this name draws on the processor."""
    return any(name in device for name in ("llvmpipe", "softpipe", "SwiftShader"))
