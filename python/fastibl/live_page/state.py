"""A snapshot as numbers for the page; all of them are the session's own."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from statistics import median
from typing import Any

import numpy as np

from .._fastibl import Environment, FrameResult, MainLight, Plan
from .board_advice import BoardAdvice
from .pictures import Light
from .snapshot import Snapshot

# The step whose methods a pass of the plan runs.
_STEP_OF = {
    "track": "tracking",
    "capture": "capture",
    "irradiance": "diffuse",
    "shadow": "shadow",
    "self_shadow": "self_shadow",
    "bounce": "bounce",
    "shade": "glossy",
}


def state_of(snapshot: Snapshot, light: Light, advice: BoardAdvice) -> dict[str, Any]:
    """What the page shows besides the pictures; numbers that are not finite become None."""
    result, newest = snapshot.result, snapshot.newest
    milliseconds = _medians(snapshot)
    recording = snapshot.recording
    return _finite(
        {
            "version": snapshot.version,
            "picture": snapshot.picture,
            "state": snapshot.state,
            "reason": snapshot.reason,
            "age": time.monotonic() - snapshot.made,
            "source": snapshot.source,
            "size": [snapshot.rig.back.width, snapshot.rig.back.height],
            "front": snapshot.rig.front is not None,
            "dropped": snapshot.dropped,
            "left_out": snapshot.left_out,
            "fps": snapshot.fps,
            "milliseconds": milliseconds,
            "messages": [{"number": number, "text": text} for number, text in snapshot.messages],
            "preparing": snapshot.preparing,
            "recording": recording and dict(zip(("path", "written", "dropped"), recording, strict=True)),
            "settings": dict(vars(snapshot.settings)) if snapshot.settings is not None else {},
            "board": _board(result) | {"advice": advice.of(snapshot)},
            "light": _light(snapshot, newest, light),
            "plan": None if newest is None else _plan(newest.plan, milliseconds),
        }
    )


def _medians(snapshot: Snapshot) -> dict[str, float]:
    """Milliseconds by pass: median of the last frames in which it ran."""
    names = sorted({name for timing in snapshot.timings for name in timing})
    return {name: 1e3 * median([t[name] for t in snapshot.timings if name in t]) for name in names}


def _board(result: FrameResult | None) -> dict[str, Any]:
    if result is None:
        return {"seen": False, "turned": False}
    pose, tracked = result.back_from_marker, result.tracked
    shown: dict[str, Any] = {"seen": pose is not None, "turned": result.turned is not None}
    shown["moved"] = result.board_moved
    if pose is not None:
        shown["metres"] = float(np.linalg.norm(pose.translation))
    if tracked is not None:
        covariance = np.asarray(tracked.covariance)
        shown |= {
            "edges": tracked.edges,
            "tags": len(tracked.tags),
            "residual": tracked.residual_px,
            "degrees": math.degrees(math.sqrt(max(np.trace(covariance[:3, :3]) / 3, 0))),
            "millimetres": 1e3 * math.sqrt(max(np.trace(covariance[3:, 3:]) / 3, 0)),
            "ambiguous": tracked.ambiguous,
        }
    return shown


def overlay_of(snapshot: Snapshot) -> dict[str, Any] | None:
    """Pixels of the marker's axes (origin, x, y, z; 5 cm each) and of the border of the shadow map on the plane."""
    result = snapshot.result
    if result is None or result.back_from_marker is None:
        return None
    camera, pose = snapshot.rig.back, result.back_from_marker
    shadow = result.shadow_map
    (x, y), e = shadow.centre, shadow.extent
    axes = np.vstack([np.zeros(3), 0.05 * np.eye(3)])
    border = np.array([(x - e, y - e, 0), (x + e, y - e, 0), (x + e, y + e, 0), (x - e, y + e, 0)])
    camera_from = pose.rotation.T, pose.translation
    pixels = camera.project(np.vstack([axes, border]) @ camera_from[0] + camera_from[1]).tolist()
    return _finite({"axes": pixels[:4], "shadow": pixels[4:] if e > 0 else []})


def _light(snapshot: Snapshot, newest: FrameResult | None, light: Light) -> dict[str, Any] | None:
    if newest is None or newest.environment is None:
        return None
    environment: Environment = newest.environment
    look = light.look(snapshot)
    low, high = environment.predicted_interval
    return {
        "given": snapshot.given,
        "coverage": environment.coverage,
        "clipped": environment.clipped,
        "knowledge": {name: float(value) for name, value in environment.knowledge.items()},
        "error": newest.predicted_error,  # error of the capture and of the methods
        "captured": environment.predicted_error,  # error of the capture alone, and its interval
        "interval": [low, high],
        "guidance": "" if look is None else str(look.guidance),
        "share": 0.0 if look is None else look.guidance.share,
        "lights": [] if look is None else [_lamp(lamp) for lamp in look.lights],
    }


def _lamp(lamp: MainLight) -> dict[str, Any]:
    """azimuth: degrees from the board's +y towards +x, in the direction of the map's picture; elevation: above the
    plane."""
    x, y, z = lamp.direction
    return {
        "azimuth": math.degrees(math.atan2(x, y)),
        "elevation": math.degrees(math.asin(max(-1.0, min(1.0, z)))),
        "share": lamp.share,
        "radius": math.degrees(lamp.angular_radius),
        "metres": None if lamp.position is None else float(np.linalg.norm(lamp.position)),
        "irradiance": list(lamp.irradiance),
    }


def _plan(plan: Plan, milliseconds: Mapping[str, float]) -> dict[str, Any]:
    return {
        "passes": [
            {
                "name": p.name,
                "step": _STEP_OF.get(p.name),
                "method": p.method,
                "included": p.included,
                "reason": p.reason,
                "error": p.error,
                "expected": p.milliseconds,
                "measured": milliseconds.get(p.name) if p.included else None,
            }
            for p in plan.passes
        ],
        "expected_error": plan.expected_error,
        "assured_error": plan.assured_error,
        "best_error": plan.best_error,
        "expected": plan.milliseconds,
        "meets_error": plan.meets_error,
        "meets_milliseconds": plan.meets_milliseconds,
        "text": str(plan),
    }


def _finite(value: Any) -> Any:
    """Replaces numbers that are not finite by None: JSON has no infinity."""
    if isinstance(value, dict):
        return {name: _finite(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
