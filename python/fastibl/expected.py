"""Errors that name what was expected and what came, for what is no array."""

from __future__ import annotations

from numbers import Real
from typing import Any


def expect(value: Any, kinds: type | tuple[type, ...], what: str, hint: str = "") -> None:
    """Raises TypeError unless `value` is of one of these types. hint: what to do instead, in a few words."""
    kinds = kinds if isinstance(kinds, tuple) else (kinds,)
    if isinstance(value, kinds):
        return
    names = [{Real: "a number", type(None): "None"}.get(kind, kind.__name__) for kind in kinds]
    expected = " or ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
    got = "None" if value is None else type(value).__name__
    raise TypeError(f"{what} must be {expected}, got {got}{': ' + hint if hint else ''}")
