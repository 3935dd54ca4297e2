"""A recording once more, under other light: the poses it was tracked with, the light of a map.

python relight.py my-recording room.hdr out.png        the last frame, as it was lit and as it would be
"""

from __future__ import annotations

import sys

import cv2
import numpy as np

import fastibl


def relit(film: fastibl.Recording, light: fastibl.CubeMap | None) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """The last picture with a figurine, (h, w, 3) uint8 RGB; without a map, in the light that the film captured."""
    mesh = fastibl.stand(fastibl.shapes.figurine(), height=0.15)
    session = fastibl.Session(fastibl.Scene(mesh, fastibl.Material()), film.rig, film.board, environment=light)
    image = np.zeros((0, 0, 3), np.uint8)
    for frame in film:
        result = session.process(frame)
        if frame.back is not None:  # a front picture alone only adds to the light
            image = np.asarray(result.image)
    return image


def main(arguments: list[str]) -> None:
    recording, light, out = arguments
    film = fastibl.Recording.open(recording)
    images = [relit(film, None), relit(film, fastibl.read_environment(light))]
    cv2.imwrite(out, np.hstack(images)[..., ::-1])
    print(f"wrote {out}: the captured light, and that of {light}")


if __name__ == "__main__":
    main(sys.argv[1:])
