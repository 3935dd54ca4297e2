"""Goals of the product (files, live view, packages, faults): table "product". One file a subject; each adds rows."""

from . import (
    start,  # noqa: F401
)
