"""cmft (last commit 2019-08, built with -O3 -march=native -ffast-math) is not run here: no package manager has it.

Errors are over the same seven maps. CPU times are for one thread of the machine on which the yardstick took 4.0 ms, as
they were measured when fastibl was begun; they are converted to seconds of this run by this run's yardstick.
"""

from __future__ import annotations

from ..measure import Row, row, timing, yardstick_seconds

_YARDSTICK = 4.0e-3
_SETTING = "figures kept, not run"
# Median and worst nMAE of phongbrdf at 128^2, by level.
_PHONG = {
    513.0: (0.0009, 0.009), 233.0: (0.0013, 0.008), 106.0: (0.0015, 0.006), 49.0: (0.0020, 0.005),
    23.0: (0.0026, 0.007), 11.0: (0.0029, 0.008), 5.4: (0.0029, 0.011),
}  # fmt: skip


def rows() -> list[Row]:
    def seconds(given: float):
        scaled = given / _YARDSTICK * yardstick_seconds()
        return timing([scaled], [scaled])

    out = [
        row(
            "cmft", "median of 7 maps", "nMAE of the irradiance; seconds a map", 0.0065, seconds(8e-3), setting=_SETTING
        ),
        row("cmft", "worst of 7 maps", "nMAE of the irradiance; seconds a map", 0.044, setting=_SETTING),
        row("cmft", "Phong, 8 levels from 128^2", "only time", time=seconds(0.9), setting=_SETTING),
        row("cmft", "Phong, 8 levels from 256^2", "only time", time=seconds(13.6), setting=_SETTING),
        row("cmft", "Phong, 8 levels from 128^2, lobe cut at 1e-12", "only time", time=seconds(2.0), setting=_SETTING),
    ]
    for p, (middle, worst) in _PHONG.items():
        metric = f"nMAE of the Phong level p={p:g} from 128^2"
        out.append(row("cmft", "median of 7 maps", metric, middle, setting=_SETTING))
        out.append(row("cmft", "worst of 7 maps", metric, worst, setting=_SETTING))
    return out
