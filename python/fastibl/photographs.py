"""Photographs of a board, by a camera that need not be calibrated."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ._fastibl import Environment, Rig, Scene
from .calibration.guess import guess_camera
from .camera_files import read_pixels
from .expected import expect
from .guessed_rig import DEGREES
from .recording import Frame, warn_of_primaries


class Photographs:
    """Photographs of one place and board, as the frames of a back camera.

    paths: .png, .jpg, … of one size, by one camera that was not zoomed. board: the one that they show.
    rig: with a calibrated camera, whose pictures are as the sensor took them. None finds the lens by
    `calibration.guess_camera`; pictures then stand upright, as EXIF says. degrees: the usual angle across a
    picture's longer side.
    lens_deviation: relative standard deviation of the focal length; None where a rig was given.

    Exposures are not told: a session takes them from the board's white. Raises ValueError without paths; for pictures
    that cannot be read and for those of several sizes, as soon as they are read: at once without a rig.
    """

    def __init__(
        self,
        paths: Sequence[str | os.PathLike[str]],
        board: Any,
        rig: Rig | None = None,
        *,
        degrees: float = DEGREES,
    ):
        expect(rig, (Rig, type(None)), "rig")
        if isinstance(paths, (str, os.PathLike)):
            raise TypeError(f"paths must be a list of photographs, as [{str(paths)!r}], got one alone")
        self.paths, self.board, self._upright = tuple(map(Path, paths)), board, rig is None
        if not self.paths:
            raise ValueError("a photograph is needed, got none")
        self.lens_deviation: float | None = None
        if rig is None:
            camera, self.lens_deviation = guess_camera(
                [self._read(path) for path in self.paths], board, degrees=degrees
            )
            rig = Rig(camera)
        self.rig = rig
        warn_of_primaries(self.paths[0])

    def _read(self, path: Path) -> Any:
        return read_pixels(path, any_depth=True, upright=self._upright)

    def __len__(self) -> int:
        return len(self.paths)

    def __iter__(self) -> Iterator[Frame]:
        """One frame a second."""
        for k, path in enumerate(self.paths):
            yield Frame(float(k), back=self._read(path), back_exposure=None)

    def light(self, scene: Scene, **options: Any) -> Environment | None:
        """The light that all of them show together at the scene's place; None where none shows the board.

        options: those of Session, which captures it."""
        from .session import Session

        session, captured = Session(scene, self.rig, self.board, **options), None
        for frame in self:
            captured = session.process(frame).environment
        return captured
