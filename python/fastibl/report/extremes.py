"""The suite of extreme cases, where this build has it."""

from __future__ import annotations

from .inputs import Inputs
from .section import Section

_WHAT = """Suns a hundred million times as bright as the sky, black maps, maps with holes, mirrors and chalk, cameras at
grazing angles: each case states what must hold, and what came out."""


def measure(inputs: Inputs) -> Section:
    section = Section("extremes", "Extreme cases", _WHAT)
    section.missing = "This build has no suite of extreme cases."
    return section
