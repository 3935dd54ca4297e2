"""Pictures of the cases by the library, before they are rounded to bytes."""

from __future__ import annotations

from functools import cache

import numpy as np

import fastibl
from fastibl.session import Methods

from . import cases
from .cases import Picture


@cache
def _session(mesh: str) -> fastibl.Session:
    return fastibl.Session(cases.scene(mesh), fastibl.Rig(cases.camera()), error=0.0)


def session(case: cases.Case) -> fastibl.Session:
    kept = _session(case.mesh)
    kept.set_material(cases.MATERIALS[case.material])
    return kept


def scene(case: cases.Case) -> fastibl.Scene:
    return session(case).scene


def render(case: cases.Case, methods: Methods = "auto", eye: cases.Eye | None = None) -> Picture:
    """A picture by these methods, in a session that has seen other light before and must keep nothing of it."""
    kept = session(case)
    kept.set_methods(methods)
    kept.set_environment(fastibl.Environment(cases.environment(case.map)))
    kept.process(fastibl.Frame(0.0, back_from_marker=cases.pose(eye), back_exposure=cases.exposure(case.map)))
    return picture(kept, eye)


def picture(kept: fastibl.Session, eye: cases.Eye | None = None) -> Picture:
    """The picture of a session's last frame."""
    layer, rgba = kept.object, np.zeros((cases.HEIGHT, cases.WIDTH, 4))
    part = layer.rgba
    rgba[layer.y : layer.y + part.shape[0], layer.x : layer.x + part.shape[1]] = part
    return Picture(rgba, kept.plane_gain.sample(cases.plane_points(eye)).astype(np.float64))
