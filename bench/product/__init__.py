"""Goals of the product (files, live view, packages, faults): table "product". One file a subject; each adds rows."""

from . import (
    exports,  # noqa: F401
    program,  # noqa: F401
    live,  # noqa: F401
    start,  # noqa: F401
)
