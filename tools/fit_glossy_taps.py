"""Fits the table of cpp/fastibl/scene/glossy_table.inc: where a glossy lobe is looked up, and how wide.

    python tools/fit_glossy_taps.py > cpp/fastibl/scene/glossy_table.inc      (NumPy alone, some minutes)

The lobe (n.h)^s max(n.l, 0) is approximated by 1 to 4 round lobes ((1 + c) / 2)^(e / 2) c around directions in the
plane of n and v. The round lobes are those that the chain holds (e = 2 * 4^k) and their blends. Directions, widths and
weights are chosen to minimise the squared difference of the lobes over the sphere; no map is involved. Rows: exponent
2^1 ... 2^17; columns: sqrt(1 - cos theta_v) from 0 to 1. Below exponent 8 spherical harmonics up to order 4 around one
direction are used.
"""

import math
import sys
from functools import partial

import numpy as np

ROWS = [2.0**k for k in range(1, 18)]
SH_ROWS = [1.0, 2.0, 4.0, 8.0]
COLUMNS = 17


def width(exponent):
    return 2 / math.sqrt(exponent)


def lobe_samples(s, theta, steps=256, turns=128):
    """Directions and weights of the lobe, from midpoints in (n.h)^(s+1) and azimuth, and its integral."""
    c = ((np.arange(steps) + 0.5) / steps) ** (1 / (s + 1))
    phi = (np.arange(turns) + 0.5) / turns * 2 * np.pi
    h = np.sqrt(1 - c * c)
    half = np.stack([h[:, None] * np.cos(phi), h[:, None] * np.sin(phi), np.repeat(c[:, None], turns, 1)], -1)
    half = half.reshape(-1, 3)
    view = np.array([math.sin(theta), 0, math.cos(theta)])
    vh = half @ view
    light = 2 * vh[:, None] * half - view
    weight = np.maximum(vh, 0) * np.maximum(light[:, 2], 0)
    return light, weight / weight.sum(), weight.mean() * 4 * 2 * np.pi / (s + 1)


_heights = {}


def height(e):
    if e not in _heights:
        x = (np.arange(4000) + 0.5) / 4000
        _heights[e] = 8 * np.pi / (e + 2) * np.mean(np.maximum(2 * x ** (2 / (e + 2)) - 1, 0))
    return _heights[e]


def round_lobe(c, log_width):
    """The chain's lobe with a given width, which blends two neighbouring levels. c: cosine of the angle to its axis."""
    k = math.floor(-(log_width - 0.5))  # exponent 2 * 4^k has width sqrt(2) / 2^k
    f = -(log_width - 0.5) - k

    def level(e):
        return np.maximum(c, 0) * np.exp(e / 2 * np.log(np.maximum((1 + c) / 2, 1e-30))) / height(e)

    return (1 - f) * level(2 * 4.0**k) + f * level(2 * 4.0 ** (k + 1))


class Problem:
    def __init__(self, s, theta, along=110, across=50):
        self.s, self.theta = s, theta
        light, weight, _ = lobe_samples(s, theta)
        mean = weight @ light
        self.centre = math.atan2(-mean[0], mean[2])
        axis, tangent = self.axes(self.centre)
        x, z, y = light @ tangent, light @ axis, light[:, 1]
        self.along = math.sqrt(weight @ np.arctan2(x, z) ** 2)
        self.across = math.sqrt(weight @ np.arctan2(y, np.hypot(x, z)) ** 2)
        wide = max(self.along, self.across)
        low, high = max(self.centre - 5 * wide, -np.pi), min(self.centre + 5 * wide, np.pi)
        psi = low + (np.arange(along) + 0.5) / along * (high - low)
        u = (np.arange(across) + 0.5) / across
        top = min(4.5 * wide, np.pi / 2)
        p, f = np.meshgrid(psi, top * u**1.5, indexing="ij")
        area = np.cos(f) * (top * 1.5 * u**0.5 / across) * 2 * (high - low) / along
        d = np.stack([-np.cos(f) * np.sin(p), np.sin(f), np.cos(f) * np.cos(p)], -1).reshape(-1, 3)
        h = d + np.array([math.sin(theta), 0, math.cos(theta)])
        nh = h[:, 2] / np.maximum(np.linalg.norm(h, axis=1), 1e-9)
        lobe = np.where(nh > 0, np.exp(s * np.log(np.clip(nh, 1e-12, 1))), 0) * np.maximum(d[:, 2], 0)
        area = area.ravel()
        self.d, self.lobe = d, lobe / (lobe @ area)
        self.root = np.sqrt(area) / math.sqrt(area @ self.lobe**2)

    @staticmethod
    def axes(angle):
        return np.array([-math.sin(angle), 0, math.cos(angle)]), np.array([-math.cos(angle), 0, -math.sin(angle)])

    def unpack(self, x, taps):
        """Offsets from the mirror direction in widths, log2 of the taps' widths in widths, and weights."""
        logits = np.concatenate([[0], x[2 * taps :]])
        weights = np.exp(logits - logits.max())
        return x[:taps], x[taps : 2 * taps], weights / weights.sum()

    def residual(self, x, taps, towards, pull):
        w = width(self.s)
        offsets, widths, weights = self.unpack(x, taps)
        error = -self.lobe
        for offset, log_width, weight in zip(offsets, widths, weights, strict=True):
            axis, _ = self.axes(self.theta + offset * w)
            error = error + weight * round_lobe(self.d @ axis, min(log_width + math.log2(w), 0.5))
        horizon = 3 * np.maximum(self.theta + offsets * w - np.pi / 2 + 0.002, 0) / w
        return np.concatenate([error * self.root, horizon, pull * (x - towards)])

    def start(self, taps):
        w = width(self.s)
        spread = np.linspace(-1, 1, taps) if taps > 1 else np.zeros(1)
        stretch = 1.1 * math.sqrt(max(self.along**2 - self.across**2, (0.25 * self.along) ** 2))
        offsets = (np.minimum(self.centre + spread * stretch, np.pi / 2 - 0.01) - self.theta) / w
        narrow = max(self.across, 0.5 * self.along) if taps > 1 else math.sqrt(self.along * self.across)
        return np.concatenate([offsets, np.full(taps, math.log2(narrow / w)), np.zeros(taps - 1)])


def minimise(f, x, rounds=40):
    """The method of Levenberg and Marquardt with numeric derivatives."""
    damping, r = 1e-3, f(x)
    cost = r @ r
    for _ in range(rounds):
        jacobian = np.stack([(f(x + step) - r) / 1e-4 for step in 1e-4 * np.eye(len(x))], axis=1)
        normal, gradient = jacobian.T @ jacobian, jacobian.T @ r
        for _ in range(8):
            step = np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-6), -gradient)
            trial = f(x + np.clip(step, -0.5, 0.5))
            if trial @ trial < cost:
                break
            damping *= 4
        else:
            break
        gain, x, r = cost - trial @ trial, x + np.clip(step, -0.5, 0.5), trial
        cost, damping = r @ r, damping / 3
        if gain < 1e-7 * cost + 1e-10:
            break
    return x, cost


def angle_of(column):
    return math.acos(max(1 - (column / (COLUMNS - 1)) ** 2, 0.0))


def fit_taps(taps):
    """(rows, columns, 3 taps): offset, log2 width, weight of each tap."""
    table = np.zeros((len(ROWS), COLUMNS, 3 * taps))
    above = None  # solution of the last column in the row before
    for i, s in enumerate(ROWS):
        beside = above
        for j in range(COLUMNS - 1, -1, -1):
            p = Problem(s, angle_of(j))
            own = p.start(taps)
            if beside is None:
                x, _ = minimise(partial(p.residual, taps=taps, towards=own, pull=0.0), own)
            else:
                first = beside if j else np.concatenate([np.zeros(taps), beside[taps:]])
                x, _ = minimise(partial(p.residual, taps=taps, towards=first, pull=0.03), first)
            if j == COLUMNS - 1:
                above = x
            beside = x
            offsets, widths, weights = p.unpack(x, taps)
            table[i, j] = np.stack([offsets, np.minimum(widths, 0.5 - math.log2(width(s))), weights], 1).ravel()
        shape = np.linalg.norm(p.residual(x, taps, x, 0))
        print(f"taps {taps} exponent {s:g}: difference {shape:.3f} at normal incidence", file=sys.stderr, flush=True)
    return table


def legendre(x):
    """P_0 ... P_4."""
    return np.array([np.ones_like(x), x, (3 * x**2 - 1) / 2, (5 * x**3 - 3 * x) / 2, (35 * x**4 - 30 * x**2 + 3) / 8])


def bands(light, weight, angle):
    return legendre(light @ Problem.axes(angle)[0]) @ weight


def fit_harmonics():
    """(rows, columns, 5): angle from the mirror direction, then the factors of bands 1 ... 4 around that direction."""
    table = np.zeros((len(SH_ROWS), COLUMNS, 5))
    for i, s in enumerate(SH_ROWS):
        for j in range(COLUMNS):
            theta = angle_of(j)
            light, weight, _ = lobe_samples(s, theta, 128, 64)
            # The direction that keeps the most of bands 1 ... 4 (2l + 1 coefficients each, one of them zonal).
            angles = np.radians(np.arange(0, 60, 0.25))
            kept = [((2 * np.arange(1, 5) + 1) * bands(light, weight, a)[1:] ** 2).sum() for a in angles]
            best = angles[int(np.argmax(kept))] if j else 0.0
            table[i, j] = [best - theta, *bands(light, weight, best)[1:]]
    return table


def log_integrals():
    """(rows, columns): log2 of s times the integral of the lobe; the rows are SH_ROWS[:1] and ROWS."""
    rows = [1.0, *ROWS]
    out = np.zeros((len(rows), COLUMNS))
    for i, s in enumerate(rows):
        for j in range(COLUMNS):
            out[i, j] = math.log2(s * lobe_samples(s, angle_of(j), 2000, 400)[2])
    return out


def written(name, table, digits):
    flat = [f"{v:.{digits}g}" for v in table.ravel()]
    flat = [v if ("." in v or "e" in v) else v + "." for v in flat]
    lines, line = [], ""
    for v in flat:
        v = ("0." if float(v) == 0 else v) + "f,"
        if len(line) + len(v) > 99:
            lines.append(line)
            line = ""
        line += v
    lines.append(line)
    shape = "".join(f"[{n}]" for n in table.shape)
    print(f"constexpr float {name}{shape.replace('][', ' * ').replace(' ', ' ')} = {{")
    print("\n".join(lines) + "};")


if __name__ == "__main__":
    print("// Made by tools/fit_glossy_taps.py: change it there.")
    written("kLogIntegrals", log_integrals(), 5)
    written("kHarmonics", fit_harmonics(), 4)
    for count in (1, 2, 3, 4):
        written(f"kTaps{count}", fit_taps(count), 4)
