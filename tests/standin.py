"""A printed page for tests: what the simulator asks of a board, and no more; and its discs in pictures."""

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


def disc_rim(centre):
    """Points (64, 3) on the rim of one of the page's discs."""
    angles = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    return np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=-1) * Page.radius + [*centre, 0.0]


def centroid_of(outline):
    """Of the area in a polygon (n, 2): that of a disc, which perspective moves away from the projected centre."""
    a, b = outline, np.roll(outline, -1, axis=0)
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return ((a + b) * cross[:, None]).sum(axis=0) / (3 * cross.sum())


def centroid_seen(light, expected):
    """Of what is dark within 14 pixels of a place in a grey linear picture."""
    x0, y0 = np.floor(expected).astype(int) - 14
    window = light[y0 : y0 + 29, x0 : x0 + 29]
    dark = np.clip(np.percentile(window, 80) * 0.85 - window, 0, None)
    y, x = np.mgrid[y0 : y0 + 29, x0 : x0 + 29] + 0.5
    return np.array([(x * dark).sum(), (y * dark).sum()]) / dark.sum()
