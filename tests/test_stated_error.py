"""A captured map's statement about its own error, where no board measures the light."""

import numpy as np

import fastibl
from fastibl.comparison import irradiance_error

CENTRE = (0, 0, 0.06)


def film_of(path):
    return fastibl.simulate(
        seconds=4, fps=8, size=(160, 120), seed=3, board=False, path=path, hand=False, lamp=False, truth_size=64
    )


def readings(film, front_alone, every=1):
    """(error, low, high, guessed) of the map after each frame; of every `every`th, the front picture is taken."""
    capture, out = fastibl.Capture(size=64, centre=CENTRE), []
    for index, frame in enumerate(film):
        pose = film.truth.pose(frame.time)
        if not front_alone:
            capture.add(frame.back, film.rig.back, pose, exposure=frame.back_exposure, time=frame.time)
        if index % every == 0:
            turned = film.rig.front_from_back @ pose
            capture.add(frame.front, film.rig.front, turned, exposure=frame.front_exposure, time=frame.time)
        environment = capture.environment()
        assert environment.plane_irradiance is None
        low, high = environment.predicted_interval
        assert low <= environment.predicted_error <= high
        error = irradiance_error(environment, film.truth.environment(frame.time))
        out.append((error, low, high, environment.knowledge["guessed_plane"]))
    return np.array(out).T


def test_the_interval_without_a_board_holds_the_error():
    sweep, inside = film_of("sweep"), []
    for name, film, front_alone, every in (
        ("both cameras", sweep, False, 1),
        ("both, a wandering hand", film_of("hand"), False, 1),
        ("the front camera", sweep, True, 1),
        ("seven pictures of it", sweep, True, 5),
    ):
        error, low, high, guessed = readings(film, front_alone, every)
        inside.append((low <= error) & (error <= high))
        print(
            f"{name}: {inside[-1].mean():.0%} inside, {(error > high).mean():.0%} above; median error "
            f"{np.median(error):.1%}, width {np.median(high - low):.1%}, in the guessed plane {np.median(guessed):.0%}"
        )
        assert (error > high).mean() <= 0.15
        assert high[-1] < 0.02 or name != "both cameras"  # it has seen everything
        # The front camera sees hardly anything of the table, which takes a fifth of the light and more.
        assert guessed[-1] > 0.1 if front_alone else guessed.max() == 0
    assert np.mean(inside) >= 0.85
