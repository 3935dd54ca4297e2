"""Peers are extras: what is missing is skipped with the reason, and nothing of the library needs one."""

import builtins
import math
import shutil

import numpy as np
import pytest

import fastibl
from bench import peers
from bench.inputs import MAPS
from bench.peers import cmft, cmgen, shared
from fastibl import reference


def test_missing_peers_are_skipped(monkeypatch, capsys):
    if not MAPS:
        pytest.skip("no real HDR maps")
    monkeypatch.setattr(shutil, "which", lambda name: None)
    real = builtins.__import__

    def without(name, *rest, **options):
        if name == "py360convert":
            raise ImportError(name)
        return real(name, *rest, **options)

    monkeypatch.setattr(builtins, "__import__", without)
    chosen = ("py360convert", "cmgen, GGX", "three.js", "cmft")
    monkeypatch.setattr(peers, "PEERS", {name: peers.PEERS[name] for name in chosen})
    cmgen._made.cache_clear()
    before = fastibl.threads()
    rows = peers.rows()
    assert fastibl.threads() == before
    assert {r.method for r in rows} == {"cmft"} and all(math.isfinite(r.error) for r in rows if r.error is not None)
    said = capsys.readouterr().err
    for word in ("pip install py360convert", "apt install libfilament-tools", "no node and npm"):
        assert word in said


def test_truth_of_the_peers():
    """Their brute force is a weighted mean: a constant stays, and harmonics of a gradient are exact."""
    ones = np.ones((6, 16, 16, 3))
    np.testing.assert_allclose(
        shared.convolved([ones, 2 * ones], 4, 0.3), np.array([1, 2])[:, None, None] + np.zeros((2, 96, 3))
    )
    d, angles, _ = reference.samples(ones)
    basis = np.stack([0.282095 + 0 * d[:, 0], *(0.488603 * d[:, k] for k in (1, 2, 0))])
    sh = np.zeros((9, 3))
    sh[:4] = ((basis * angles) @ (2 + d[:, 0]))[:, None]  # L = 2 + x
    n = shared.normals(20)
    np.testing.assert_allclose(shared.irradiance_of(sh, n)[:, 0], 2 * np.pi + 2 * np.pi / 3 * n[:, 0], rtol=1e-3)


def test_kept_figures_are_scaled_by_the_yardstick(monkeypatch):
    monkeypatch.setattr(cmft, "yardstick_seconds", lambda: 0.008)
    slow = next(r for r in cmft.rows() if r.case == "Phong, 8 levels from 128^2")
    assert slow.seconds == pytest.approx(1.8)
