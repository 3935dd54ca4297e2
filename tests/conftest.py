"""Shared places and helpers. Real maps and meshes lie beside the project; what needs them skips without."""

import atexit
import os
import shutil
import tempfile
from pathlib import Path

# Processes share the cores. OpenBLAS's threads wait for each other in a loop: where other processes have the cores, the
# small products of a fit take several times as long. It reads this once, when NumPy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest

import fastibl
from fastibl.measuring.samples import units  # noqa: F401 - for tests

# What tests bake they keep to themselves.
if "FASTIBL_CACHE" not in os.environ:
    os.environ["FASTIBL_CACHE"] = tempfile.mkdtemp(prefix="fastibl-tests-")
    atexit.register(shutil.rmtree, os.environ["FASTIBL_CACHE"], ignore_errors=True)
fastibl.set_threads(1)  # as with OpenBLAS; tests of more threads set them

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
MAPS = sorted((SHARED / "hdri").glob("*.hdr"))


@pytest.fixture(scope="session")
def real_maps():
    """The seven real HDR maps as cube maps of 128 squared texels, by name."""
    if not MAPS:
        pytest.skip(f"no real HDR maps under {SHARED}")
    return {path.stem.removesuffix("_1k"): fastibl.read_environment(path) for path in MAPS}


@pytest.fixture(scope="session")
def marked():
    """An asymmetric cube map: every face another colour, with a bright spot off its middle."""
    faces = np.zeros((6, 32, 32, 3))
    faces += np.array([(1, 0.1, 0.1), (0.1, 1, 1), (0.1, 1, 0.1), (1, 0.1, 1), (0.1, 0.1, 1), (1, 1, 0.1)])[
        :, None, None
    ]
    faces[:, 4:8, 18:24] = 6
    return fastibl.CubeMap(faces)


def same_error(call, kind, *words):
    """The call raises `kind`, and the message holds all words."""
    with pytest.raises(kind) as caught:
        call()
    for word in words:
        assert word in str(caught.value), str(caught.value)


def in_picture(layer, camera, dtype=np.float32):
    """An object's layer in its place in the whole picture (h, w, 4)."""
    whole = np.zeros((camera.height, camera.width, 4), dtype)
    h, w = layer.rgba.shape[:2]
    whole[layer.y : layer.y + h, layer.x : layer.x + w] = layer.rgba
    return whole
