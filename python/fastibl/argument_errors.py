"""Explains a call of the extension with arguments that do not fit: what is wrong, instead of all that would fit.

pybind11 answers such a call with signatures; the extension gives that answer to `explain`
(cpp/bindings/argument_errors.h).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence, Set
from numbers import Real
from operator import index
from reprlib import repr
from typing import Any, NamedTuple, SupportsIndex

from . import _fastibl
from .expected import wrong_type

# The types that each annotation of pybind11 accepts. Other annotations (arrays, callables) have error messages of their
# own.
_KINDS: dict[str, type] = {
    "typing.SupportsFloat": Real,
    "typing.SupportsInt": SupportsIndex,
    "typing.SupportsIndex": SupportsIndex,
    "str": str,
    "bool": bool,
    "dict": dict,
    "list": list,
    "tuple": tuple,
    "None": type(None),
    "collections.abc.Sequence": Sequence,
    "collections.abc.Mapping": Mapping,
    "collections.abc.Set": Set,
    "typing.Annotated": Sequence,  # of a fixed length
}
_OPENING, _CLOSING = "([{", ")]}"


class _Parameter(NamedTuple):
    name: str
    annotation: str
    kinds: tuple[type, ...]  # empty: anything is accepted, as far as can be told here
    needed: bool
    by_name: bool  # comes after a bare *

    def said(self) -> str:
        """The name, where it has one; what an attribute is set to has none."""
        return "it" if re.fullmatch(r"arg\d", self.name) else self.name

    def has_room_for(self, value: Any) -> bool:
        """False if a whole number is expected and the value is one that is too large or below 0."""
        if SupportsIndex not in self.kinds or value is None:
            return True
        try:
            return 0 <= index(value) < 2**31
        except TypeError:  # an array
            return False

    def holds_odd_text(self, value: Any) -> bool:
        """Whether texts are expected and something else is among them."""
        return self.annotation.endswith("[str]") and not all(isinstance(v, str) for v in value)

    def expected(self) -> str:
        """Says what is expected; for a sequence, also what it should hold."""
        text = self.annotation.replace("typing.SupportsFloat | typing.SupportsIndex", "numbers")
        text = text.replace(f"{_fastibl.__name__}.", "")
        text = text.replace("typing.SupportsInt | typing.SupportsIndex", "whole numbers")
        sized = r'typing\.Annotated\[collections\.abc\.Sequence\[([^][]*)\], "FixedSize\((\d+)\)"\]'
        while re.search(sized, text):
            text = re.sub(sized, r"(\2 \1)", text)
        return re.sub(r"collections\.abc\.(\w+)\[([^][]*)\]", r"\1 of \2", text)


def _split(text: str, at: str) -> list[str]:
    """Splits at a character that is outside brackets and quotes."""
    parts, depth, quote = [""], 0, ""
    for c in text:
        if quote:
            quote = "" if c == quote else quote
        elif c in "'\"":
            quote = c
        else:
            depth += (c in _OPENING) - (c in _CLOSING)
        if c == at and not depth and not quote:
            parts.append("")
        else:
            parts[-1] += c
    return [p.strip() for p in parts]


def _kind(annotation: str) -> type | None:
    outer = annotation.partition("[")[0]
    if outer.startswith("fastibl._fastibl."):
        return getattr(_fastibl, outer.rpartition(".")[2], None)
    return _KINDS.get(outer)


def _parameters(signature: str) -> list[_Parameter]:
    found, by_name = [], False
    for text in _split(signature, ","):
        if text == "*":
            by_name = True
        if not re.match(r"\w+:", text):
            continue
        name, _, rest = text.partition(":")
        annotation, *default = _split(rest, "=")
        told = [_kind(a) for a in _split(annotation, "|")]
        kinds = [k for k in told if k is not None]
        if None in told:
            kinds = []
        elif Real in kinds:  # whole numbers are real numbers, too
            kinds = [k for k in kinds if k is not SupportsIndex]
        found.append(_Parameter(name, annotation, tuple(dict.fromkeys(kinds)), not default, by_name))
    return found


def explain(message: str, args: tuple, kwargs: Mapping[str, Any]) -> str:
    """Says what is wrong with the first argument that does not fit; pybind11's message where this cannot be told.

    args: with `self`.
    """
    signatures = re.findall(r"^ {4}\d+\. (.*)$", message, re.MULTILINE)
    if len(signatures) != 1:
        return message
    match = re.match(r"(?:fastibl\._fastibl\._?(\w+))?\((.*)\)(?: -> .*)?$", signatures[0])
    if match is None:
        return message
    constructed, every = match[1], _parameters(match[2])
    name = constructed or message.partition("(")[0] or "it"
    args = args[1:] if constructed or (every and every[0].name == "self") else args
    every = [p for p in every if p.name != "self"]
    names = ", ".join(p.name for p in every) or "no arguments"
    by_place = [p for p in every if not p.by_name]
    if len(args) > len(by_place):
        most = f"{len(by_place)} without a name" if len(by_place) < len(every) else str(len(by_place))
        return f"{name} takes at most {most} ({names}), got {len(args)}"
    given = {p.name: value for p, value in zip(by_place, args, strict=False)}
    for key in kwargs:
        if key in given:
            return f"{name} got {key} twice"
        if key not in {p.name for p in every}:
            return f"{name} takes no {key}: {names}"
    given.update(kwargs)
    maybe = ""  # None is no error for arguments that pybind11 takes by pointer: the signature does not tell which
    for p in every:
        if p.name not in given:
            if p.needed:
                return f"{name} needs {p.name}: {names}"
            continue
        value, what = given[p.name], p.said()
        if not isinstance(value, p.kinds or object):
            if value is None and all(kind.__module__ == _fastibl.__name__ for kind in p.kinds):
                maybe = maybe or wrong_type(value, p.kinds, what)
                continue
            return wrong_type(value, p.kinds, what)
        if not p.has_room_for(value):
            return f"{what} must be a whole number from 0 to {2**31 - 1}, got {repr(value)}"
    if maybe:
        return maybe
    holders = [p for p in every if "[" in p.annotation and p.name in given]
    if len(holders) > 1:
        holders = [p for p in holders if p.holds_odd_text(given[p.name])][:1]
    if holders:
        return f"{holders[0].said()} must be {holders[0].expected()}, got {repr(given[holders[0].name])}"
    return message
