"""How maps, light, shadows, plans and frames are shown: automatically in notebooks, elsewhere by `fastibl.plot`.

`picture` needs nothing but OpenCV; `plot` needs matplotlib (pip install matplotlib), when it is called.
"""

from __future__ import annotations

import html
from collections.abc import Sequence
from functools import singledispatch
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._fastibl import CubeMap, Environment, FrameResult, Plan, Response, ShadowMap
from .comparison import Comparison
from .expected import expect
from .guidance import Guidance
from .lighting import Lighting
from .panorama import panorama_rays, seen_map

_GREY = 0.25  # of white: how bright a map's median is shown, so that lamps clip and dark corners can be seen
_UNSEEN = 0.35  # of its brightness: how bright light that no camera saw is shown
_MATTE, _GLOSSY = 0.8, 64.0  # albedo and exponent of the spheres that show a Lighting


@singledispatch
def picture(thing: Any, height: int = 256, exposure: float | None = None) -> NDArray[np.uint8]:
    """A picture (h, w, 3) uint8 RGB of a CubeMap, Environment, Lighting, ShadowMap, FrameResult or Guidance.

    height: in pixels; frames and guidance keep their own. Maps are shown as equirectangular pictures (z at the top, +y
    in the middle), with their median at a quarter of white; what no camera saw is dimmed. A Lighting is shown by a
    matte, a glossy and a mirror sphere, seen along +y. In the picture of a ShadowMap, row 0 is the largest y, as one
    looks at the board.
    exposure: of a CubeMap, Environment or Lighting; radiance times this is shown, 1 as white, in place of what its own
    median gives. With one exposure, as the `auto_exposure` of one of them, several can be compared.
    Raises TypeError for anything else, ValueError for a height below 8, and for an exposure that is not positive or of
    something else.
    """
    raise TypeError(f"no picture of {type(thing).__name__}; there are pictures of CubeMap, Environment, Lighting, "
                    "ShadowMap, FrameResult and Guidance")  # fmt: skip


@picture.register
def _(thing: CubeMap, height: int = 256, exposure: float | None = None) -> NDArray[np.uint8]:
    linear = _panorama(thing, height)
    return _bytes(linear * _chosen(exposure, linear))


@picture.register
def _(thing: Environment, height: int = 256, exposure: float | None = None) -> NDArray[np.uint8]:
    seen = seen_map(thing).sample(panorama_rays(height))
    return (picture(thing.radiance, height, exposure) * (_UNSEEN + (1 - _UNSEEN) * seen)).astype(np.uint8)


@picture.register
def _(thing: Lighting, height: int = 256, exposure: float | None = None) -> NDArray[np.uint8]:
    _check(height)
    inside, lit = _spheres(thing, height)
    scale = _chosen(exposure, lit[0])
    panels = []
    for values in lit:
        panel = np.full((height, height, 3), 255, np.uint8)
        panel[inside] = _bytes(values * scale)
        panels.append(panel)
    return np.concatenate(panels, axis=1)


def _spheres(lighting: Lighting, height: int) -> tuple[NDArray[np.bool_], tuple[NDArray[np.float32], ...]]:
    """Where a sphere covers a square picture, and its radiance (n, 3) there: matte, glossy and as a mirror."""
    y, x = (np.mgrid[:height, :height] + 0.5) / height * 2.2 - 1.1
    inside = x**2 + y**2 < 1
    depth = np.sqrt(np.maximum(1 - x**2 - y**2, 0))
    normals = np.stack([x, -depth, -y], axis=-1)[inside]  # z points up, and the eye is at -y
    views = np.broadcast_to([0.0, -1.0, 0.0], normals.shape)
    lit = (
        _MATTE / np.pi * lighting.irradiance(normals),
        lighting.glossy(normals, views, exponent=_GLOSSY),
        lighting.glossy(normals, views, exponent=float("inf")),
    )
    return inside, lit


def auto_exposure(thing: CubeMap | Environment | Lighting, height: int = 256) -> float:
    """The exposure with which `picture` shows something by itself: it puts its median at a quarter of white."""
    expect(thing, (CubeMap, Environment, Lighting), "thing")
    if isinstance(thing, Lighting):
        return _scale(_spheres(thing, height)[1][0])
    return _scale(_panorama(thing.radiance if isinstance(thing, Environment) else thing, height))


@picture.register
def _(thing: ShadowMap, height: int = 256, exposure: float | None = None) -> NDArray[np.uint8]:
    _check(height)
    _check_none(exposure, thing)
    y, x = ((np.mgrid[:height, :height] + 0.5) / height * 2 - 1) * thing.extent
    points = np.stack([x + thing.centre[0], -y + thing.centre[1]], axis=-1)
    return _bytes(thing.sample(points))


@picture.register
def _(thing: FrameResult, height: int = 256, exposure: float | None = None) -> NDArray[np.uint8]:
    _check_none(exposure, thing)
    image = np.asarray(thing.image)
    if image.shape[-1] == 3:
        return image
    alpha = image[..., 3:] / 255  # straight alpha, laid over white
    return _bytes(Response.srgb().decode(image[..., :3] / 255) * alpha + (1 - alpha))


@picture.register
def _(thing: Guidance, height: int = 256, exposure: float | None = None) -> NDArray[np.uint8]:
    _check_none(exposure, thing)
    return thing.image


def png(thing: Any) -> bytes:
    """The result of `picture` as a PNG file. Raises what `picture` raises."""
    import cv2

    return cv2.imencode(".png", np.ascontiguousarray(picture(thing)[..., ::-1]))[1].tobytes()


@singledispatch
def table(thing: Any) -> str:
    """A Plan or a Comparison as an HTML table. Raises TypeError for anything else."""
    raise TypeError(f"no table of {type(thing).__name__}; there are tables of Plan and Comparison")


@table.register
def _(thing: Plan) -> str:
    rows = []
    for p in thing.passes:
        error = "" if p.error is None else _percent(p.error)
        time = "" if p.milliseconds is None or not p.included else f"{p.milliseconds:.2f} ms"
        method = p.method if p.included else f"left out: {p.reason}"
        rows.append((p.name, method, error, time))
    total = "" if thing.expected_error is None else _percent(thing.expected_error)
    rows.append(("in all", "", total, f"{thing.milliseconds:.2f} ms"))
    foot = "" if thing.assured_error is None else f"<p>The picture is within {_percent(thing.assured_error)}.</p>"
    if thing.light_unjudged > 0:
        foot += f"<p>{_percent(thing.light_unjudged)} of the light is new since that was judged.</p>"
    if thing.error_budget > 0:
        foot += f"<p>{_kept(thing.meets_error)} the error budget of {_percent(thing.error_budget)}.</p>"
    if thing.milliseconds_budget > 0:
        foot += f"<p>{_kept(thing.meets_milliseconds)} the time budget of {thing.milliseconds_budget:g} ms.</p>"
    if thing.light_error is not None and np.isfinite(thing.light_error):
        foot += (
            f"<p>The captured light is expected to be off by {_percent(thing.light_error)}, whatever the methods.</p>"
        )
    if thing.sampling_error is not None:
        foot += (
            f"<p>Four samples a pixel leave {_percent(thing.sampling_error)}, whatever the methods; supersampling "
            "draws more.</p>"
        )
    if thing.light_in_turns:
        foot += "<p>The light is made in turns, one step a frame: some frames late.</p>"
    return _html(("pass", "method", "expected error", "expected time"), rows) + foot


@table.register
def _(thing: Comparison) -> str:
    rows = [
        (name, _percent(thing.rmse[name]), _percent(thing.scale_invariant_rmse[name]), f"{thing.angular[name]:.2f}°")
        for name in thing.rmse
    ]
    foot = f"<p>Median error of the irradiance: {_percent(thing.median)}.</p>"
    return _html(("sphere", "RMSE", "scale-invariant", "angle of RGB"), rows) + foot


def plot(thing: Any, axes: Any = None, title: str | None = None, *, exposure: float | None = None) -> Any:
    """Draws a CubeMap, Environment, Lighting, ShadowMap, FrameResult, Guidance, Plan or Comparison; returns the axes.

    axes: matplotlib's axes to draw into; None makes a figure. title: text above it. exposure: as of `display.picture`,
    to show several on one scale. Maps have their directions along
    the edges, a ShadowMap has metres; a Plan and a Comparison are drawn as bars. Raises TypeError for anything else,
    ImportError without matplotlib.
    """
    try:
        from matplotlib import pyplot
    except ImportError as error:
        raise ImportError("fastibl.plot needs matplotlib: pip install matplotlib") from error
    if axes is None:
        wide = isinstance(thing, CubeMap | Environment | Lighting | Guidance)
        axes = pyplot.subplots(figsize=(8, 4) if wide else (5, 4), layout="constrained")[1]
    if isinstance(thing, Plan | Comparison):
        _check_none(exposure, thing)
    if isinstance(thing, Plan):
        _plot_plan(thing, axes)
    elif isinstance(thing, Comparison):
        _plot_comparison(thing, axes)
    else:
        _plot_picture(thing, axes, exposure)
    if title is not None:
        axes.set_title(title)
    return axes


def _plot_picture(thing: Any, axes: Any, exposure: float | None) -> None:
    image = picture(thing, exposure=exposure)
    if isinstance(thing, CubeMap | Environment):
        axes.imshow(image, extent=(-180, 180, -90, 90), aspect="auto" if axes.get_subplotspec() is None else 1)
        axes.set_xticks((-180, -90, 0, 90, 180), ("−y", "−x", "+y", "+x", "−y"))
        axes.set_yticks((-90, 0, 90), ("−z", "0", "+z"))
    elif isinstance(thing, ShadowMap):
        (x, y), e = thing.centre, thing.extent
        axes.imshow(image, extent=(x - e, x + e, y - e, y + e))
        axes.set_xlabel("x, metres"), axes.set_ylabel("y, metres")
    else:
        axes.imshow(image)
        axes.set_axis_off()


def _plot_plan(plan: Plan, axes: Any) -> None:
    taken = [p for p in plan.passes if p.included]
    names = [f"{p.name}\n{p.method}" if p.method else p.name for p in taken]
    axes.barh(names, [p.milliseconds or 0 for p in taken], color="#0072B2")
    for k, p in enumerate(taken):
        if p.error is not None:
            axes.text(p.milliseconds or 0, k, f" {_percent(p.error)}", va="center", fontsize=8)
    axes.invert_yaxis()
    axes.set_xlabel("expected milliseconds; beside the bars: error")


def _plot_comparison(comparison: Comparison, axes: Any) -> None:
    names = list(comparison.rmse)
    places = np.arange(len(names))
    axes.bar(places - 0.2, [100 * comparison.rmse[n] for n in names], 0.4, label="RMSE", color="#D55E00")
    values = [100 * comparison.scale_invariant_rmse[n] for n in names]
    axes.bar(places + 0.2, values, 0.4, label="after one factor", color="#0072B2")
    axes.set_xticks(places, names)
    axes.set_ylabel("% of the true mean")
    axes.legend()


def _check(height: int) -> None:
    if height < 8:
        raise ValueError(f"height must be at least 8 pixels, got {height}")


def _panorama(cube: CubeMap, height: int) -> NDArray[np.float32]:
    """Linear radiance (h, 2h, 3) in the directions of an equirectangular picture's pixels."""
    _check(height)
    return cube.sample(panorama_rays(height), float(np.log2(max(2 * cube.size / height, 1))))


def _scale(linear: NDArray) -> float:
    middle = float(np.median(linear.mean(axis=-1)))
    return _GREY / middle if middle > 0 else 1.0


def _chosen(exposure: float | None, linear: NDArray) -> float:
    if exposure is None:
        return _scale(linear)
    if not (np.isreal(exposure) and 0 < exposure < np.inf):
        raise ValueError(f"exposure must be positive and finite, got {exposure!r}")
    return float(exposure)


def _check_none(exposure: float | None, thing: Any) -> None:
    if exposure is not None:
        raise ValueError(f"exposure is for a CubeMap, Environment or Lighting, not for a {type(thing).__name__}")


def _bytes(linear: NDArray) -> NDArray[np.uint8]:
    """Encodes as sRGB, clipped at white."""
    return np.rint(255 * Response.srgb().encode(np.clip(linear, 0, 1))).astype(np.uint8)


def _kept(budget: bool) -> str:
    return "Within" if budget else "<b>Not within</b>"


def _percent(value: float) -> str:
    return f"{100 * value:.2g} %" if value < 1 else f"{100 * value:.0f} %"


def _html(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    def line(cells: tuple[str, ...], tag: str) -> str:
        return "<tr>" + "".join(f'<{tag} style="text-align: left">{html.escape(c)}</{tag}>' for c in cells) + "</tr>"

    return f"<table>{line(head, 'th')}{''.join(line(r, 'td') for r in rows)}</table>"


def attach() -> None:
    """Lets notebooks show these classes automatically."""
    pictured: tuple[Any, ...] = (CubeMap, Environment, Lighting, ShadowMap, FrameResult, Guidance)
    for kind in pictured:
        kind._repr_png_ = png
    tabled: tuple[Any, ...] = (Plan, Comparison)
    for kind in tabled:
        kind._repr_html_ = table


__all__ = ["auto_exposure", "picture", "plot", "png", "table"]
