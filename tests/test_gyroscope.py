"""Gyroscope logs as telephones' programs write them."""

import numpy as np
import pytest

from fastibl.gyroscope import Gyroscope, read_gyroscope

TIMES = 81234.5 + np.arange(50) / 100
RATES = np.random.default_rng(0).normal(0, 1, (50, 3)).round(5)


def table(separator, *columns, decimal="."):
    rows = [separator.join(f"{v:.9f}".replace(".", decimal) if isinstance(v, float) else str(v) for v in row)
            for row in zip(*(np.asarray(c).tolist() for c in columns), strict=True)]  # fmt: skip
    return "\n".join(rows) + "\n"


X, Y, Z = RATES.T
NANOSECONDS = np.round(TIMES * 1e9).astype(np.int64)
LOGS = {
    "no header": table(",", TIMES, X, Y, Z),
    "spaces and a comment": "# a gyroscope\n" + table(" ", TIMES, X, Y, Z),
    "timestamp,gx,gy,gz": "timestamp,gx,gy,gz\n" + table(",", TIMES, X, Y, Z),
    "Sensor Logger": "time,seconds_elapsed,z,y,x\n" + table(",", NANOSECONDS, TIMES, Z, Y, X),
    "phyphox": '"Time (s)";"Gyroscope x (rad/s)";"Gyroscope y (rad/s)";"Gyroscope z (rad/s)";"Absolute (rad/s)"\n'
    + table(";", TIMES, X, Y, Z, np.linalg.norm(RATES, axis=1), decimal=","),
    "SensorLog": "loggingTime(txt),loggingSample(N),motionTimestamp_sinceReboot(s),accelerometerAccelerationX(G),"
    "accelerometerAccelerationY(G),accelerometerAccelerationZ(G),gyroRotationX(rad/s),gyroRotationY(rad/s),"
    "gyroRotationZ(rad/s)\n" + table(",", ["2026-11-27T10:00:00"] * 50, range(50), TIMES, Y, Z, X, X, Y, Z),
    "nanoseconds of Android": table(",", NANOSECONDS, X, Y, Z),
    "milliseconds, degrees": "t (ms)\twx (deg/s)\twy (deg/s)\twz (deg/s)\n"
    + table("\t", 1000 * TIMES, *np.degrees(RATES).T),
    "milliradians": "t (s),x (mrad/s),y (mrad/s),z (mrad/s)\n" + table(",", TIMES, *(1000 * RATES).T),
    "thousandths of degrees": "t (s),x (mdps),y (mdps),z (mdps)\n" + table(",", TIMES, *np.degrees(1000 * RATES).T),
    "semicolons, decimal commas": table(";", TIMES, X, Y, Z, decimal=","),
    "tabs, decimal commas": table("\t", TIMES, X, Y, Z, decimal=","),
    "spaces, decimal commas": table(" ", TIMES, X, Y, Z, decimal=","),
    "commas and spaces": table(", ", TIMES, X, Y, Z),
    "repeated and out of order": table(",", TIMES[[1, 0, 1, *range(1, 50)]], *RATES[[1, 0, 1, *range(1, 50)]].T),
}


@pytest.mark.parametrize("name", LOGS)
def test_logs(tmp_path, name):
    (tmp_path / "log").write_text(LOGS[name], encoding="utf-8")
    times, rates = read_gyroscope(tmp_path / "log")
    np.testing.assert_allclose(times, TIMES, atol=1e-6)
    np.testing.assert_allclose(rates, RATES, atol=1e-6)


@pytest.mark.parametrize(
    "text, told",
    [
        ("", "holds 0 lines"),
        ("1,2,3\n" * 5, "four columns, time and three rates, or a header; got 3"),
        ("time,x,y\n" + "1,2,3\n" * 5, "one each of the rates about x, y and z, got time, x, y"),
        ("time,ax,bx,y,z\n" + "1,2,3,4,5\n" * 5, "one each of the rates"),
        ("time,x,y,z\n1,2,3,4\n2,2,3,4\n3,2,three,4\n", "line 4: expected numbers, got '3,2,three,4'"),
        ("time,x,y,z\n1,2,3,4\n2,2,3\n", "line 3: expected numbers"),
        ("# a log\n\ntime,x,y,z\n# begun\n1,2,3,4\n\n2,2,bad,3\n3,2,3,4", "line 7: expected numbers, got '2,2,bad,3'"),
        ("1,0,0,0\n" * 5, "are no gyroscope's"),
        ("time,x (rpm),y (rpm),z (rpm)\n0,1,2,3\n0.01,1,2,3\n", "rates in 'rpm'; expected rad/s or deg/s"),
        ("time (s),x,y,z\n" + "".join(f"{5 * k},0,0,0\n" for k in range(9)), "times 5 apart are no gyroscope's"),
    ],
)
def test_what_is_no_log(tmp_path, text, told):
    (tmp_path / "log").write_text(text)
    with pytest.raises(ValueError) as error:
        read_gyroscope(tmp_path / "log")
    print(error.value)
    assert told in str(error.value)


@pytest.mark.parametrize("cut", ["0.5,0.1", "0.5,0.1,0.", "0.5,0.1,-,"])
def test_a_last_line_that_is_cut_off_is_left_out(tmp_path, cut):
    (tmp_path / "log").write_text("# a log\n" + table(",", TIMES, X, Y, Z) + cut)
    with pytest.warns(UserWarning, match=f"log line 52, its last, is cut off and left out: '{cut}'") as told:
        times, _ = read_gyroscope(tmp_path / "log")
    assert told[0].filename == __file__
    np.testing.assert_allclose(times, TIMES, atol=1e-6)
    (tmp_path / "log").write_text(table(",", TIMES, X, Y, Z).rstrip("\n"))
    np.testing.assert_allclose(read_gyroscope(tmp_path / "log")[0], TIMES, atol=1e-6)


def test_a_first_reading_of_whole_numbers(tmp_path):
    (tmp_path / "log").write_text("time, x, y, z\n0, 0, 0, 0\n0.01, 0.1, 0.2, 0.3\n0.02, 0.1, 0.2, 0.3\n")
    times, rates = read_gyroscope(tmp_path / "log")
    np.testing.assert_allclose(times, [0, 0.01, 0.02])
    np.testing.assert_allclose(rates[1:], [[0.1, 0.2, 0.3]] * 2)


def test_attitudes_of_a_steady_turn():
    """90 degrees a second about the gyroscope's z, which is the camera's minus y; a drift about its x."""
    times, mount = np.arange(0, 2, 0.01), np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    rates, drift = np.tile([0.0, 0.0, np.pi / 2], (200, 1)), np.array([0.1, 0.0, 0.0])
    found = Gyroscope(times, rates, mount, 0.01, drift, 0.5).attitudes([-0.5, 0.123, 1.4, 1.6])
    assert found[3] is None  # its clock is half a second ahead
    np.testing.assert_allclose(found[0], np.eye(3), atol=1e-12)
    for time, attitude in zip((0.623, 1.9), found[1:3], strict=True):
        w = time * (np.array([0.0, np.pi / 2, 0.0]) + drift)  # camera_now_from_rest
        angle, axis = np.linalg.norm(w), w / np.linalg.norm(w)
        k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
        np.testing.assert_allclose(attitude, np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k, atol=1e-9)
    with pytest.raises(ValueError, match="within 52 degrees only: turn the camera .* about more than one"):
        Gyroscope(times, rates, mount, 0.9, drift, 0.5).attitudes([0.0])


@pytest.mark.parametrize(
    ("times", "rates", "mount", "said"),
    [
        ([0.0], [[0, 0, 0]], np.eye(3), "two readings or more at times that increase, got 1"),
        ([0.0, 0.0], [[0, 0, 0]] * 2, np.eye(3), "times that increase"),
        ([0.0, 1.0], [[0, 0, 0]], np.eye(3), r"rates must be \(2, 3\) of finite numbers, got \(1, 3\)"),
        ([0.0, np.nan], [[0, 0, 0]] * 2, np.eye(3), "times must be"),
        ([0.0, 1.0], [[0, 0, 0]] * 2, np.eye(4), r"camera_from_gyro must be \(3, 3\)"),
        (0.0, [[0, 0, 0]], np.eye(3), r"times must be \(1,\)"),
    ],
)
def test_what_is_no_gyroscope(times, rates, mount, said):
    with pytest.raises(ValueError, match=said):
        Gyroscope(times, rates, mount, 0.01, np.zeros(3), 0.0)


def test_a_hole_in_the_log_is_no_turn():
    """A second of rest, two without readings, in which nobody knows what was turned, and three of rest."""
    times = np.concatenate([np.arange(0, 1, 0.01), np.arange(3, 6, 0.01)])
    rates = np.zeros((len(times), 3))
    rates[99] = rates[100] = [0, 0, 1.0]
    gyroscope = Gyroscope(times, rates, np.eye(3), 0.01, np.zeros(3), 0.0)
    with pytest.warns(UserWarning, match="1 holes of up to 2 s: attitudes of 3 of 6 times"):
        found = gyroscope.attitudes([0.2, 0.9, 2.0, 3.1, 4.0, 5.9])
    assert [a is not None for a in found] == [False, False, False, True, True, True]
    for attitude in found[4:]:
        np.testing.assert_allclose(attitude, found[3], atol=1e-12)
    with pytest.warns(UserWarning, match="attitudes of 2 of 3 times"):
        assert gyroscope.attitudes([0.2, 0.5, 4.0])[2] is None
