"""A printed page for tests: what the simulator asks of a board, and no more."""

import numpy as np


class Page:
    """White A5 page with black discs and a black square; metres, x right, y up, centred on the origin."""

    width, height = 0.21, 0.148
    discs = ((-0.08, 0.05), (0.08, 0.05), (0.08, -0.05), (-0.08, -0.05), (0.0, 0.055))
    radius = 0.006
    square = 0.05  # edge, in the middle

    def image(self, dpi):
        density = dpi / 0.0254
        shape = round(self.height * density), round(self.width * density)
        x = (np.arange(shape[1]) + 0.5) / shape[1] * self.width - self.width / 2
        y = self.height / 2 - (np.arange(shape[0]) + 0.5)[:, None] / shape[0] * self.height
        black = (np.abs(x) < self.square / 2) & (np.abs(y) < self.square / 2)
        for u, v in self.discs:
            black |= (x - u) ** 2 + (y - v) ** 2 < self.radius**2
        return np.where(black, 0, 255).astype(np.uint8)
