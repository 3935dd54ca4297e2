"""One binary runs on plain x86-64 and uses AVX2 where it is: the same results on an emulated CPU without it."""

import platform
import shutil
import subprocess
import sys

import numpy as np
import pytest

PROGRAM = """
import sys
import numpy as np
import fastibl
rng = np.random.default_rng(3)
cube = fastibl.CubeMap(rng.random((6, 16, 16, 3)) ** 4)
spheres = np.concatenate([rng.normal(size=(20, 3)) * 0.05 + [0, 0, 0.1], rng.random((20, 1)) * 0.04 + 0.01], axis=1)
camera = fastibl.Camera(64, 48, fx=60, fy=60, cx=32, cy=24)
tetrahedron = fastibl.Mesh(rng.normal(size=(4, 3)) * 0.05 + [0, 0, 0.1], [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
scene = fastibl.Scene(tetrahedron, spheres=8, visibility_rays=8)
pose = fastibl.Pose.from_rotation_vector([np.pi * 0.75, 0.0, 0.0], [0.0, 0.0, 0.5])
session = fastibl.Session(scene, fastibl.Rig(camera), environment=cube)
image = session.process(fastibl.Frame(0.0, back=np.full((48, 64, 3), 120, np.uint8), back_from_marker=pose)).image
np.savez(sys.argv[1], shadow=fastibl.cast_shadow(cube, spheres).image, image=image,
         irradiance=fastibl.Lighting(cube).irradiance(rng.normal(size=(50, 3))))
"""


def test_results_without_avx2(tmp_path):
    emulator = shutil.which("qemu-x86_64")
    if emulator is None or platform.machine() != "x86_64":
        pytest.skip("needs qemu-x86_64 (Debian: qemu-user) on x86-64")
    paths = [tmp_path / "native.npz", tmp_path / "emulated.npz"]
    program = [sys.executable, "-c", PROGRAM]
    subprocess.run([*program, str(paths[0])], check=True)
    subprocess.run([emulator, "-cpu", "Nehalem", *program, str(paths[1])], check=True, timeout=300)
    native, emulated = (np.load(path) for path in paths)
    for name in native.files:
        difference = np.abs(native[name].astype(float) - emulated[name]).max()
        print(f"{name}: largest difference {difference:.2e}")
        assert difference <= (1 if name == "image" else 2e-5)
