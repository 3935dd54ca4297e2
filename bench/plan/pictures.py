"""Four cases, by `./dev bench plan-pictures`: by the paper's methods, by those that the plan chose for 2 %, the truth,
and five times the difference of the last two, around grey."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

import fastibl

from ..measure import ROOT
from . import cases, render, truth
from .cases import Case
from .promise import chosen

CASES = (
    Case("venice_sunset", "teapot", "white"),
    Case("empty_warehouse_01", "teapot", "metal"),
    Case("kiara_1_dawn", "suzanne", "satin"),
    Case("potsdamer_platz", "suzanne", "metal"),
)
OUT = ROOT / "docs" / "images" / "plan-errors.jpg"


def strip(case: Case) -> NDArray[np.float64]:
    plan = fastibl.make_plan(render.scene(case), cases.environment(case.map), error=0.02, track=False)
    encode = cases.camera().response.encode
    paper, ours = (cases.composite(render.render(case, m), case.map) for m in ("paper", chosen(plan)))
    true = cases.composite(truth.truth(case.map, case.mesh, case.material), case.map)
    shown = [np.asarray(encode(p.astype(np.float32))) for p in (paper, ours, true)]
    return np.concatenate([*shown, np.clip(0.5 + 5 * (ours - true), 0, 1)], axis=1)


def main() -> list[Path]:
    picture = (255 * np.concatenate([strip(c) for c in CASES])).round().astype(np.uint8)
    larger = cv2.resize(picture, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    cv2.imwrite(str(OUT), larger[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 88])
    return [OUT]
