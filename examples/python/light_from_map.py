"""The light of a map on your own surfaces, as numbers: irradiance, glossy light, nine spherical harmonics.

python light_from_map.py room.hdr        without a map: the built-in room
"""

from __future__ import annotations

import sys

import numpy as np

import fastibl
from fastibl.room import Room


def main(arguments: list[str]) -> None:
    cube = fastibl.read_environment(arguments[0], size=64) if arguments else Room().truth(size=64)
    lighting = fastibl.Lighting(cube)
    up = np.array([[0.0, 0.0, 1.0]])
    towards_eye = np.array([[0.0, 0.6, 0.8]])
    print("irradiance of a table:", lighting.irradiance(up)[0])
    print("what it mirrors, roughness 0.3:", lighting.ggx(up, towards_eye, roughness=0.3)[0])
    print("mean radiance, by the first harmonic:", lighting.sh9[0] * 0.282095)
    for light in lighting.lights:
        print("a light towards", np.round(light.direction, 2), "gives", np.round(light.irradiance, 3))


if __name__ == "__main__":
    main(sys.argv[1:])
