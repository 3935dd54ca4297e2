"""Docstrings as the site shows them: parameters explained as `name: text` become a list, types are shortened."""

from __future__ import annotations

import inspect
import re

# What the extension's signatures spell out, and how people write it.
_TYPES = (
    (r"typing\.SupportsFloat \| typing\.SupportsIndex", "float"),
    (r"typing\.SupportsInt \| typing\.SupportsIndex", "int"),
    (r"typing\.Annotated\[(.*?), ['\"]FixedSize\((\d+)\)['\"]\]", r"\1"),
    (r"\bobject\b(?! at )", "ArrayLike"),
    (r"(?:numpy\.typing\.|collections\.abc\.|fastibl\._fastibl\.|typing\.|numpy\.)", ""),
)


def shorter(signature: str) -> str:
    for pattern, text in _TYPES:
        signature = re.sub(pattern, text, signature)
    return re.sub(r"\(self: [^,)]+(?:, )?", "(", signature)


def extension_signature(thing: object) -> tuple[str, str] | None:
    """Arguments and result, as pybind11 writes them in a docstring's first line; for a class, its constructor's."""
    text = (getattr(thing, "__init__", None) if inspect.isclass(thing) else thing).__doc__ or ""
    match = re.match(r"\w+(\(.*\))(?: -> (.*))?$", text.split("\n", 1)[0])
    if not match:
        return None
    result = "" if inspect.isclass(thing) or not match[2] or match[2] == "None" else shorter(match[2])
    return shorter(match[1]), result


def parameters(signature: str | None) -> set[str]:
    """The names of the parameters in a signature such as "(a: int = 1, *, b)"."""
    return set(re.findall(r"[(,]\s*\**(\w+)\s*(?=[:=,)])", signature or ""))


def rst(lines: list[str], names: set[str]) -> list[str]:
    """A docstring in reStructuredText: each parameter of `names` that is explained gets a line of its own."""
    paragraphs = re.split(r"\n\s*\n", inspect.cleandoc("\n".join(lines)))
    return "\n\n".join(_paragraph(p, names) for p in paragraphs if p.strip()).split("\n") + [""]


def _paragraph(text: str, names: set[str]) -> str:
    if text.startswith("- "):
        return "\n".join("* " + _inline(_line(item[2:])) for item in re.split(r"\n(?=- )", text))
    text = _line(text)
    if not names:
        return _inline(text)
    name = "(?:" + "|".join(sorted(map(re.escape, names), key=len, reverse=True)) + ")"
    before, *rest = re.split(rf"(?:^|(?<=[.;)] )|(?<=\)\. ))({name}(?:, {name})*): ", text)
    if not rest:
        return _inline(text)
    blocks = [_inline(before.strip())] if before.strip() else []
    items, after = [], ""
    for key, value in zip(rest[::2], rest[1::2], strict=True):
        value, end = _ended(value.strip())
        items.append(f"* **{key}**: {_inline(value)}")
        after += end
    blocks.append("\n".join(items))
    return "\n\n".join(blocks + ([_inline(after)] if after else []))


def _line(text: str) -> str:
    return re.sub(r"\s*\n\s*", " ", text)


def _ended(text: str) -> tuple[str, str]:
    """Cuts off what a paragraph says, after its last parameter, about the call as a whole."""
    cut = re.search(r"(?<=[.;)] )(?=(?:Returns|Raises) )", text)
    return (text[: cut.start()].strip(), text[cut.start() :]) if cut else (text, "")


def _inline(text: str) -> str:
    """Turns `code` into ``code``, and escapes characters elsewhere that mean something in reStructuredText."""
    parts = re.split(r"`([^`]+)`", text)
    return "".join(f"``{p}``" if k % 2 else re.sub(r"([*|\\`]|_(?=\W|$))", r"\\\1", p) for k, p in enumerate(parts))


def setup(app) -> dict:
    """Called by Sphinx."""
    seen: dict[str, set[str]] = {}

    def on_signature(app, what, name, thing, options, signature, result):
        seen[name] = parameters(signature)
        return (shorter(signature), shorter(result or "")) if signature else None

    def on_docstring(app, what, name, thing, options, lines):
        if inspect.isclass(thing) and extension_signature(thing):  # adds the docstring of its constructor
            lines += ["", *(thing.__init__.__doc__ or "").split("\n")[1:]]
        if lines and re.match(r"\w+\(.*\)( -> .*)?$", lines[0]):
            del lines[0]
        names = set(seen.get(name, ()))
        if inspect.isclass(thing):
            names |= {n for n in vars(thing) if not n.startswith("_")} | set(getattr(thing, "__annotations__", ()))
        lines[:] = rst(lines, names - {"self"})

    app.connect("autodoc-process-signature", on_signature)
    app.connect("autodoc-process-docstring", on_docstring)
    return {"parallel_read_safe": True}
