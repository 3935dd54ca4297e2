"""Goals of the product (files, live view, packages, faults): table "product". One file per subject; each adds its
rows."""

from . import (
    batch,  # noqa: F401
    consumers,  # noqa: F401
    coverage,  # noqa: F401
    docs,  # noqa: F401
    exports,  # noqa: F401
    live,  # noqa: F401
    newcomer,  # noqa: F401
    program,  # noqa: F401
    robust,  # noqa: F401
    soak,  # noqa: F401
    start,  # noqa: F401
    wheel,  # noqa: F401
)
