"""What Hypothesis draws for the tests of properties, and what may come of it."""

import contextlib
import io
import os
import sys
import warnings

import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

# Examples are drawn the same way in every run; FASTIBL_EXAMPLES asks for more of them.
MORE = settings(
    max_examples=int(os.environ.get("FASTIBL_EXAMPLES", 60)),
    deadline=None,
    derandomize="FASTIBL_EXAMPLES" not in os.environ,
    suppress_health_check=list(HealthCheck),
)
REFUSALS = (ValueError, TypeError, OSError)

HEAD = "%YAML:1.0\n---\n"
# Calibrations that OpenCV's parser runs out of memory for calls with.
NESTED = {
    "brackets": HEAD + "a: " + "[" * 40_000,
    "json": '{"a":' * 40_000,
    "tags": '<?xml version="1.0"?>\n<opencv_storage>\n' + "<a>" * 40_000,
    "lists": HEAD + "a:\n   " + "- " * 40_000 + "1\n",
    "maps": HEAD + "a: " * 40_000,
    "indents": HEAD + "".join(" " * (62 * i) + "- " * 31 + "\n" for i in range(360)),
}
# And one that it never ends with: base64 that does not say what it holds.
ENDLESS = (
    HEAD
    + "back:\n   a: !!opencv-matrix\n      rows: 3\n      cols: 3\n      dt: d\n      data: !!binary |\n"
    + ("         " + "ICAg" * 9 + "AAAA" * 15 + "\n")
)

edges = [0.0, -0.0, 1.0, -1.0, 1e-45, 1e-30, 1e-8, 1e6, 1e9, 1e30, -1e30, 3.4e38, np.inf, -np.inf, np.nan]
numbers = st.one_of(st.floats(-2, 2), st.sampled_from(edges), st.floats())
whole_numbers = st.one_of(st.integers(-3, 70), st.sampled_from([2**31, -(2**31), 2**40]))
dtypes = st.sampled_from([np.float32, np.float64, np.float16, ">f4", np.uint8, np.uint16, np.int32, np.bool_, object])
anything = st.one_of(
    st.none(), st.booleans(), numbers, whole_numbers, st.text(max_size=8), st.lists(numbers, max_size=4)
)


def filled(shape, dtype=np.float32, elements=None):
    """Arrays of a shape with a few drawn values on one ground; of any float dtype they keep in range."""

    def make(ground, values, seed):
        with np.errstate(all="ignore"):
            array = np.full(shape, ground).astype(dtype)
            at = np.random.default_rng(seed).integers(0, max(array.size, 1), len(values))
            if array.size:
                array.reshape(-1)[at] = np.array(values).astype(dtype)
        return array

    elements = numbers if elements is None else elements
    return st.builds(make, elements, st.lists(elements, max_size=6), st.integers(0, 9))


def arrays(*shapes):
    """Arrays of one of these shapes or another, of any dtype, or what is no array."""
    shape = st.one_of(*(st.just(s) for s in shapes), hnp.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=4))
    usual = shape.flatmap(lambda s: filled(s))
    strange = st.tuples(shape, dtypes).flatmap(lambda d: filled(d[0], d[1], st.floats(0, 200)))
    return st.one_of(usual, usual, usual, strange, anything)


def outcome(call):
    """What a call gives, or None where it refuses with words. All else is a failure."""
    try:
        with quiet():
            return call()
    except REFUSALS as error:
        assert str(error), f"{type(error).__name__} without a word"
        return None


@contextlib.contextmanager
def quiet():
    """Warnings may come; decoders in C print to stderr."""
    with warnings.catch_warnings(), contextlib.redirect_stderr(io.StringIO()):
        warnings.simplefilter("ignore")
        yield
    sys.stderr.flush()


def is_light(array, most=np.inf):
    assert np.isfinite(array).all() and (np.asarray(array) >= 0).all() and (np.asarray(array) <= most).all()


def is_ratio(array):
    assert ((np.asarray(array) >= 0) & (np.asarray(array) <= 1)).all()


def mutated(content):
    """A file with bytes changed, cut out, put in, or cut off."""

    def make(edits, end):
        data = bytearray(content)
        for kind, at, value in edits:
            i = at % max(len(data), 1)
            if kind == 0 and data:
                data[i] = value
            elif kind == 1:
                del data[i : i + 1 + value % 16]
            elif kind == 2:
                data[i:i] = bytes([value]) * (1 + value % 8)
            elif kind == 3 and data:  # as a number that is none, or too large
                data[i:i] = [b"nan", b"inf", b"-1", b"1e99", b"999999999999", b"0x"][value % 6]
        return bytes(data[: end % (len(data) + 1)] if end else data)

    edit = st.tuples(st.integers(0, 3), st.integers(0, 1 << 16), st.integers(0, 255))
    return st.builds(make, st.lists(edit, max_size=5), st.one_of(st.just(0), st.just(0), st.integers(1, 1 << 16)))
