"""Goals of the product (files, live view, packages, faults): table "product". One file a subject; each adds rows."""

from . import (
    docs,  # noqa: F401
    exports,  # noqa: F401
    newcomer,  # noqa: F401
    start,  # noqa: F401
)
