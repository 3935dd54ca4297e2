"""Masked pixels tell nothing: no light, no lamp, no white, and nothing beside them."""

import board_pictures
import numpy as np
import pytest
from test_exposure_untold import BACK, BACK_POSE, BOARD

import fastibl
from conftest import same_error
from fastibl import Camera, Capture
from views import camera_of, looking

CAMERA, POSE = camera_of(320, 240, 70.0), looking((1, 0, 1.0))
UP = fastibl.texel_directions(64)[..., 2] > 0


def hidden_square():
    mask = np.ones((240, 320), np.uint8)
    mask[80:160, 120:200] = 0
    return mask


@pytest.mark.parametrize("hidden", [0.0, 1.0, 50.0])
def test_nothing_of_a_masked_place_gets_into_texels_beside_it(hidden):
    """Footprints of texels reach over several pixels."""
    mask = hidden_square()
    shown = np.where(mask[..., None] != 0, np.float32(0.2), np.float32(hidden)) * np.ones(3, np.float32)
    capture = Capture(size=64)
    capture.add(shown, CAMERA, POSE, 1.0, 0.0, mask=mask)
    env = capture.environment()
    seen = (env.confidence > 0) & UP
    np.testing.assert_allclose(env.radiance.faces[seen], 0.2, rtol=1e-5)
    whole = Capture(size=64)
    whole.add(np.full((240, 320, 3), 0.2, np.float32), CAMERA, POSE, 1.0, 0.0)
    lost = 1 - seen.sum() / ((whole.environment().confidence > 0) & UP).sum()
    print(f"hidden pixels {1 - mask.mean():.3f}, lost texels {lost:.3f}")
    assert 1 - mask.mean() < lost < 0.2


def test_nothing_gets_out_of_the_mask_of_a_wide_picture():
    wide = Camera.equirectangular(512, 256)
    mask = np.ones((256, 512), bool)
    mask[40:90, 200:300] = False
    shown = np.where(mask[..., None], np.float32(0.2), np.float32(50)) * np.ones(3, np.float32)
    capture = Capture(size=64, distance=np.inf)
    capture.add(shown, wide, looking((1, 0, 0.01)), 1.0, 0.0, mask=mask)
    env = capture.environment()
    np.testing.assert_allclose(env.radiance.faces[(env.confidence > 0) & UP], 0.2, rtol=1e-5)
    assert 0.85 < (env.confidence[UP] > 0).mean() < 1


def test_a_masked_lamp_is_not_located():
    """Two pictures from 30 cm apart show a lamp a metre and a half away."""
    lamp, radius = np.array([1.0, 0.2, 1.5]), 0.06

    def shown(pose):
        y, x = np.mgrid[0:240, 0:320] + 0.5
        rotation = np.asarray(pose.rotation)
        rays = CAMERA.unproject(np.stack([x, y], -1)) @ rotation
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
        to = lamp + rotation.T @ np.asarray(pose.translation)
        lit = rays @ (to / np.linalg.norm(to)) > np.cos(radius / np.linalg.norm(to))
        return np.where(lit[..., None], np.float32(5.0), np.float32(0.02)) * np.ones(3, np.float32), lit

    found = []
    for masked in (False, True):
        capture = Capture(size=64)
        for k, eye in enumerate(((0, 0, 0.1), (0.0, 0.3, 0.1), (0.0, -0.3, 0.2), (0.2, 0.3, 0.1)) * 3):
            pose = looking(lamp - eye, eye)
            image, lit = shown(pose)
            capture.add(image, CAMERA, pose, 0.1, 0.5 * k, mask=~lit if masked else None)
        found.append(capture.environment().light_positions)
    np.testing.assert_allclose(found[0][0, :3], lamp, atol=0.05)
    assert len(found[1]) == 0


def board_picture(exposure=0.5):
    code = board_pictures.render(BOARD, BACK, BACK_POSE.matrix)
    linear = BACK.response.decode(code.astype(np.float32) / 255)
    return np.round(255 * BACK.response.encode(np.clip(linear * exposure, 0, 1))).astype(np.uint8)


def test_the_white_is_not_read_under_a_mask():
    """A dark hand over most of the page, masked."""
    read, page = [], board_picture()
    columns = np.flatnonzero(page.max(axis=(0, 2)) > 0.9 * page.max())
    hidden = slice(columns[0] - 5, columns[0] + int(0.55 * len(columns)))
    for hand, masked in ((False, False), (True, True), (True, False)):
        shown, mask = board_picture(), np.ones((BACK.height, BACK.width), bool)
        if hand:
            shown[:, hidden] = 30
        if masked:
            mask[:, hidden] = False
        capture = Capture(size=32, board=BOARD)
        capture.add(shown, BACK, BACK_POSE, 0.5, 0.0, mask=mask)
        read.append(capture.environment().plane_irradiance)
    assert read[2] is not None and read[2][0] < 0.3 * read[0][0]
    np.testing.assert_allclose(read[1], read[0], rtol=0.02)
    capture = Capture(size=32, board=BOARD)
    capture.add(board_picture(), BACK, BACK_POSE, 0.5, 0.0, mask=np.zeros((BACK.height, BACK.width), bool))
    assert capture.environment().plane_irradiance is None and capture.environment().coverage == 0


def test_a_wholly_masked_picture_counts_as_none():
    """Wide pictures from afar do not replace what nearer ones showed: not after a masked one from there, either."""
    wide, near, far = Camera.equirectangular(256, 128), (0, 0, 0.1), (3, 0, 1.0)
    capture = Capture(size=32, distance=np.inf)
    capture.add(np.full((128, 256, 3), 0.2, np.float32), wide, looking((1, 0, 0.01), near), 1.0, 0.0)
    before = capture.environment().radiance.faces.copy()
    nothing = np.zeros((CAMERA.height, CAMERA.width), bool)
    bright = np.full((CAMERA.height, CAMERA.width, 3), 0.9, np.float32)
    capture.add(bright, CAMERA, looking((-3, 0, 1), far), 1.0, 1.0, mask=nothing)
    capture.add(np.full((128, 256, 3), 0.4, np.float32), wide, looking((1, 0, 0.01), far), 1.0, 2.0)
    above = fastibl.texel_directions(32)[..., 2] > 0
    np.testing.assert_array_equal(capture.environment().radiance.faces[above], before[above])


@pytest.mark.parametrize("shape", [(0, 0), (0, 320), (240, 0), (120, 160)])
def test_a_mask_of_another_size_is_refused(shape):
    """One of no pixels is what a segmentation that failed gives."""
    capture = Capture(size=16)
    image = np.full((240, 320, 3), 100, np.uint8)
    same_error(
        lambda: capture.add(image, CAMERA, POSE, 1.0, 0.0, mask=np.zeros(shape, np.uint8)), ValueError, "mask", "320"
    )
    assert capture.environment().coverage == 0


def test_stills_after_a_masked_one_show_what_it_hid():
    """Tiles that hardly change are left out of pictures, but not where the map has never seen them."""
    rng = np.random.default_rng(0)
    image = rng.integers(60, 180, (240, 320, 3), np.uint8)
    seen = []
    for masks in ([None], [hidden_square(), None]):
        capture = Capture(size=128)
        for mask in masks:
            capture.add(image, CAMERA, POSE, 1.0, 0.0, mask=mask)
        seen.append(capture.environment().confidence > 0)
    assert (seen[1] == seen[0]).all()


def test_one_wide_picture_leaves_no_gaps_between_its_sides():
    wide = Camera.equirectangular(256, 128)
    capture = Capture(size=128, distance=np.inf)
    capture.add(np.full((128, 256, 3), 0.2, np.float32), wide, looking((1, 0, 0.01)), 1.0, 0.0)
    assert (capture.environment().confidence[fastibl.texel_directions(128)[..., 2] > 0] > 0).all()
