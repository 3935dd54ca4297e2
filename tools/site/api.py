"""The package's public names by subject, which are the pages of the API reference."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Iterator
from importlib import import_module

from docstrings import extension_signature

# For each page: its title, what it is for, and its names. "module.name" is a name of a public module of the package; a
# name with "?" is left out if it does not exist.
PAGES = {
    "maps": (
        "Maps",
        "Light from all directions, and its files.",
        "CubeMap Environment read_environment write_environment cubemap_from_equirect equirect_from_cubemap "
        "texel_directions texel_solid_angles rotate_map main_lights MainLight without_lights compare "
        "comparison.Comparison",
    ),
    "light": (
        "Light",
        "What a map does to surfaces, by named methods.",
        "Lighting Method methods directional_albedo ggx_albedo dfg_table export_light write_sh? write_gltf_light? "
        "write_usd?",
    ),
    "objects": (
        "Objects",
        "Meshes, materials, and what they hide of the light.",
        "Mesh Material Scene read_mesh read_object stand shapes Bvh ambient_occlusion SelfShadow",
    ),
    "shadow": (
        "Shadow",
        "Shadows on the plane, and what object and plane send each other.",
        "ShadowMap shadow_ratio cast_shadow fit_spheres light_directions DirectionShadow MeshShadow Bounce "
        "PlaneExchange ObjectLayer write_shadow?",
    ),
    "cameras": (
        "Cameras and tracking",
        "Lenses, boards, poses.",
        "Camera Response Rig Pose Board Tag Tracker Tracked RotationTracker Turned DetectedTag calibration gyroscope",
    ),
    "capture": (
        "Capture",
        "Pictures and poses become a map.",
        "Capture Taken Guidance guide exposure white",
    ),
    "session": (
        "Session and plan",
        "The whole, frame by frame.",
        "Session Frame FrameResult PictureLayers write_layers Plan PlannedPass make_plan due_passes machine_costs "
        "default_costs set_threads threads live",
    ),
    "recordings": (
        "Recordings and sources",
        "Where frames come from.",
        "Recording simulate recording.Truth sources photographs recorder faults batch?",
    ),
    "display": (
        "Pictures and plots",
        "How maps, light, shadows and plans are shown; notebooks show them by themselves.",
        "plot display.picture display.auto_exposure display.png display.table",
    ),
    "truth": (
        "Truth and measurements",
        "What methods are compared with, and how they are measured.",
        "reference truth measuring",
    ),
}


def names(page: str) -> list[str]:
    return [n.rstrip("?") for n in PAGES[page][2].split() if not n.endswith("?") or _exists(n[:-1])]


def _exists(name: str) -> bool:
    try:
        find(name)
    except (AttributeError, ImportError):
        return False
    return True


def find(name: str):
    """The thing that a name of PAGES stands for."""
    found = import_module("fastibl")
    for part in name.split("."):
        found = getattr(found, part) if hasattr(found, part) else import_module(f"{found.__name__}.{part}")
    return found


def public(module) -> list[str]:
    """The names that a module offers: its __all__, or what it defines."""
    own = [n for n, o in vars(module).items() if getattr(o, "__module__", None) == module.__name__]
    return [n for n in getattr(module, "__all__", own) if not n.startswith("_") and callable(getattr(module, n))]


def documented() -> Iterator[tuple[str, object]]:
    """Every public thing with its full name: functions, classes, and what public modules offer."""
    for page in PAGES:
        for name in names(page):
            thing = find(name)
            yield f"fastibl.{name}", thing
            if inspect.ismodule(thing):
                yield from ((f"fastibl.{name}.{inner}", getattr(thing, inner)) for inner in public(thing))


def members(kind: type) -> Iterator[tuple[str, object]]:
    """Public attributes of a class that are defined by the class or by a base class of fastibl's own."""
    for base in kind.__mro__:
        if base.__module__.startswith("fastibl"):
            for name, thing in vars(base).items():
                if not name.startswith("_"):
                    yield name, getattr(kind, name) if isinstance(thing, staticmethod | classmethod) else thing


def docstrings() -> dict[str, str]:
    """The docstring of every public name, by its full name. Fields of dataclasses are described by their class."""
    found = {}
    for name, thing in documented():
        found[name] = inspect.getdoc(thing) or ""
        if inspect.isclass(thing):
            fields = set(getattr(thing, "__dataclass_fields__", ()))
            for member, value in members(thing):
                found[f"{name}.{member}"] = inspect.getdoc(value) or ("of the class" if member in fields else "")
    return found


def page(name: str) -> str:
    """The text of a page in reStructuredText."""
    title, purpose, _ = PAGES[name]
    return f"{title}\n{'=' * len(title)}\n\n{purpose}\n\n" + "\n".join(_entry(n) for n in names(name))


def _entry(name: str) -> str:
    thing = find(name)
    if not inspect.ismodule(thing):
        return _directive(f"fastibl.{name}", thing, name)
    title = f"fastibl.{name}"
    head = f"{title}\n{'-' * len(title)}\n\n.. automodule:: {title}\n\n"
    return head + "\n".join(_directive(f"{title}.{n}", getattr(thing, n), n) for n in public(thing))


def _directive(path: str, thing: object, title: str) -> str:
    if inspect.isclass(thing):
        inherited = [b.__name__ for b in thing.__mro__[1:] if not b.__module__.startswith("fastibl")]
        constructor = (extension_signature(thing) or ("",))[0]  # Sphinx does not find it by itself
        return (
            f".. autoclass:: {path}{constructor}\n   :members:\n   :undoc-members:\n"
            f"   :inherited-members: {', '.join(inherited)}\n"
        )
    return f".. autofunction:: {path}\n" if callable(thing) else f".. autodata:: {path}\n"


if __name__ == "__main__":
    for name, _ in documented():
        sys.stdout.write(name + "\n")
