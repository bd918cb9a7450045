"""Speeds of the vehicle: `run`, `run_sequence --speed` and Python, all three with the same result."""

import csv
import importlib
import json
import re

import numpy as np
import pytest
from conftest import CAMERA_HEIGHT, assert_refused, poses_of, rendered, run, tool
from geometry_msgs.msg import TwistWithCovarianceStamped, Vector3


def speeds_of(folder):
    """Stamps [s] and speeds [m/s] of the ground truth."""
    stamps, positions = np.loadtxt(folder / "times.txt"), poses_of(folder / "poses.txt")[:, :3, 3]
    path = np.append(0, np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1)))
    return stamps, np.gradient(path, stamps)


def write(file, stamps, values, column="speed_mps"):
    file.write_text(f"stamp,{column}\n" + "".join(f"{stamp:.9f},{value:.4f}\n" for stamp, value in zip(stamps, values)))
    return file


@pytest.fixture(scope="module")
def speeds(short, tmp_path_factory):
    """A CSV with the speeds of the ground truth."""
    return write(tmp_path_factory.mktemp("speed") / "speed.csv", *speeds_of(short))


def test_height_is_learned_through_all_doors(gsv, venv, short, speeds, tmp_path):
    heading, *lines = speeds.read_text().splitlines()
    speeds = tmp_path / "speeds.csv"  # with deviations
    speeds.write_text("\n".join([heading + ",sigma", *(f"{line},0.2" for line in lines), ""]))
    run(tool("run_sequence"), short, "--speed", speeds, "--out", tmp_path)
    expected = poses_of(tmp_path / short.name / "poses.txt")
    metrics = json.loads((tmp_path / short.name / "metrics.json").read_text())
    height, sigma = (metrics[f"learned_camera_height_{name}m"] for name in ("", "sigma_"))
    assert abs(height - CAMERA_HEIGHT) < 3 * sigma < 0.3
    assert metrics["rle_percent"] < 1

    drive = gsv.open_drive(short)
    odometry = gsv.MetricOdometry(drive.camera, 0, record=True, use_speed=True)
    with open(speeds, newline="") as stream:
        rows = list(csv.DictReader(stream))
    for (image, stamp), row in zip(drive, rows):
        odometry.add_speed(round(1e9 * float(row["stamp"])), float(row["speed_mps"]), sigma=float(row["sigma"]))
        result = odometry.process(image, stamp)
    np.testing.assert_allclose(odometry.poses()[:, :3], expected, atol=1e-6)
    assert (result.source, result.speed_warning) == ("both", "")
    assert result.camera_height == pytest.approx(height)
    assert result.camera_height_sigma == pytest.approx(sigma)

    done = run(venv / "bin/ground_scale_vo", "run", short, "--speed", speeds, "--out", tmp_path / "run")
    assert "camera height" in done.stdout
    np.testing.assert_allclose(poses_of(tmp_path / "run" / short.name / "poses.txt"), expected, atol=1e-6)


@pytest.mark.parametrize("status, text, content", [
    (2, "--camera-height is missing", None),
    (1, "line 1: a heading with the columns stamp and speed_mps, speed_kmh", "time,speed\n0,1\n"),
    (1, "line 1: the unit of the column speed is not known", "stamp,speed\n0,1\n"),
    (1, "line 3: has 1 columns instead of 2", "stamp,speed_mps\n0,1\n1\n"),
    (1, "line 2: 'fast' is not a finite number", "stamp,speed_kmh\n0,fast\n"),
    (1, "line 3: the stamp is not later", "stamp,speed_mps\n1,1\n1,2\n"),
    (1, "line 2: the stamp is not one in seconds, milliseconds", "stamp,speed_mps\n1e20,1\n2e20,1\n"),
    (1, "has no speed", "stamp,speed_mps\n"),
    (1, "the speeds reach 8000 m/s", "stamp,speed_mps\n0,8000\n1,8000\n"),
])
def test_refused_speeds(short, tmp_path, status, text, content):
    file = tmp_path / "speed.csv"
    words = [] if content is None else ["--speed", file]
    if content is not None:
        file.write_text(content)
    assert_refused(status, text, tool("run_sequence"), short, "--out", tmp_path / "out", *words)


LENGTH = r"length ([\d.]+) m, standard deviation ([\d.]+) m"


def length_and_sigma(text):
    return tuple(map(float, re.search(LENGTH, text).groups()))


@pytest.fixture(scope="module")
def both(low, tmp_path_factory):
    """both(file, *options): status and text of run_sequence and `run` with these speeds, and the true length."""
    out = tmp_path_factory.mktemp("out")

    def call(gsv_command, file, *options):
        words = (low, "--speed", file, *options, "--out", out)
        done = run(tool("run_sequence"), *words, check=False)
        status, output, messages = gsv_command("run", *words)
        assert status == done.returncode
        return [(done.returncode, done.stdout + done.stderr), (status, output + messages)]
    return call


def test_each_number_of_a_message_has_its_place(gsv):
    del gsv
    message = TwistWithCovarianceStamped()
    message.header.stamp.secs, message.header.stamp.nsecs = 3, 4
    message.twist.twist.linear = Vector3(5, 6, 7)
    message.twist.covariance = range(10, 46)
    assert importlib.import_module("ground_scale_vo.bags")._velocity(message, None) == (3_000_000_004, (5, 6, 7), 10)


UNITS = {"mps": 1, "kmh": 3.6, "mph": 1 / 0.44704, "knots": 3600 / 1852, "mmps": 1000}
CLOCK = 1317013370.0  # [s]


@pytest.mark.parametrize("unit", UNITS)
def test_units_give_the_same_metres(gsv_command, low, tmp_path, unit):
    """As the name of the column and as an option. Stamps in milliseconds."""
    stamps, values = speeds_of(low)
    truth = np.trapz(values, stamps)
    named, plain = (write(tmp_path / f"{column}.csv", 1e3 * stamps, UNITS[unit] * values, column)
                    for column in (f"speed_{unit}", "speed"))
    done = run(tool("run_sequence"), low, "--speed", plain, "--speed-unit", unit, "--out", tmp_path)
    status, output, messages = gsv_command("run", low, "--speed", named, "--out", tmp_path)
    assert status == 0, messages
    for text in (done.stdout + done.stderr, output + messages):
        length, sigma = length_and_sigma(text)
        assert abs(length - truth) < max(3 * sigma, 0.003 * truth), text
        assert sigma < 0.02 * truth


@pytest.mark.parametrize("factor, options, refusal", [
    (3.6, ("--camera-height", 0.6), "looks like km/h taken as m/s"),
    (1 / 0.44704, ("--camera-height", 0.6), "looks like mph taken as m/s"),
    (3600 / 1852, ("--camera-height", 0.6), "looks like knots taken as m/s"),
    (1 / 3.6, ("--camera-height", 0.6), "looks like m/s taken as km/h"),
    (1000, ("--camera-height", 0.6), "the speeds reach .* is their unit mm/s"),
    (3.6 * 3.6, ("--speed-unit", "mps"), "outside 0.2 to 4 m: their unit looks like km/h"),
    (3.6, (), "the unit of the column speed is not known"),
    (3.6, ("--speed-unit", "furlongs"), "furlongs"),
])
def test_speeds_in_another_unit_are_a_failure(low, tmp_path, factor, options, refusal):
    stamps, values = speeds_of(low)
    file = write(tmp_path / "speed.csv", stamps, factor * values, "speed")
    done = run(tool("run_sequence"), low, "--speed", file, *options, "--out", tmp_path, check=False)
    assert done.returncode == (2 if "furlongs" in options else 1) and re.search(refusal, done.stderr), done.stderr


@pytest.fixture(scope="module")
def stopping(data):
    """A KITTI folder of 24 s with a stop."""
    return rendered(data / "stopping", "--frames", 144, "--rate", 6, "--size", "400x124")


@pytest.mark.parametrize("shift, overlaps", [(CLOCK, False), (1.0, True)])
def test_another_clock_is_refused_with_the_offset(stopping, tmp_path, shift, overlaps):
    stamps, values = speeds_of(stopping)
    file = write(tmp_path / "speed.csv", stamps + shift, values)
    words = (tool("run_sequence"), stopping, "--camera-height", CAMERA_HEIGHT, "--speed", file, "--out", tmp_path)
    done = run(*words, check=False)
    assert done.returncode == 1 and ("no speed is used" not in done.stderr) == overlaps, done.stderr
    assert (tmp_path / stopping.name / "metrics.json").exists() == overlaps  # before the drive
    offset = float(re.search(r"--speed-offset (-?[\d.]+)", done.stderr)[1])
    assert offset == pytest.approx(-shift, abs=0.1)
    if overlaps:  # the advice counts from the stamps of the file
        done = run(*words, "--speed-offset", -0.4, check=False)
        assert float(re.search(r"--speed-offset (-?[\d.]+)", done.stderr)[1]) == pytest.approx(-shift, abs=0.1)
    done = run(*words, "--speed-offset", offset)
    assert length_and_sigma(done.stdout)[0] == pytest.approx(np.trapz(values, stamps), rel=0.01)


def held(stamps, values, period, phase):
    return np.interp(np.floor((stamps - phase) / period) * period + phase, stamps, values)


@pytest.mark.parametrize("sensor", ["exact", "1 Hz", "1 Hz in km/h", "1 Hz, repeated"])
@pytest.mark.parametrize("phase", [0.0, 0.4])
def test_slow_sensors_are_no_fault_and_their_error_is_covered(stopping, tmp_path, sensor, phase):
    stamps, values = speeds_of(stopping)
    truth = np.trapz(values, stamps)
    if "repeated" in sensor:
        values = held(stamps, values, 1, phase)  # at the rate of the images
    elif "1 Hz" in sensor:
        seconds = np.arange(phase, stamps[-1], 1)
        stamps, values = seconds, np.interp(seconds, stamps, values)
    if "km/h" in sensor:
        values = np.round(3.6 * values) / 3.6
    done = run(tool("run_sequence"), stopping, "--speed", write(tmp_path / "speed.csv", stamps, values), "--out", tmp_path)
    assert not re.search("later|earlier|jumps|repeats", done.stderr), done.stderr
    length, sigma = length_and_sigma(done.stdout)
    assert abs(length - truth) < 2 * sigma < 0.1 * truth, done.stdout


def test_add_speed_needs_use_speed(gsv, short):
    odometry = gsv.MetricOdometry(gsv.open_drive(short).camera, CAMERA_HEIGHT)
    with pytest.raises(ValueError, match="use_speed"):
        odometry.add_speed(0, 5.0)


def test_oxts_of_a_raw_drive(short, speeds, tmp_path):
    oxts = tmp_path / "oxts"
    (oxts / "data").mkdir(parents=True)
    stamps, values = np.loadtxt(speeds, delimiter=",", skiprows=1, unpack=True)
    lines = []
    for i, (stamp, speed) in enumerate(zip(stamps, values)):
        numbers = ["0"] * 30
        numbers[8] = str(speed)  # vf
        (oxts / "data" / f"{i:010}.txt").write_text(" ".join(numbers) + "\n")
        lines.append(f"1970-01-01 00:00:{stamp:012.9f}\n")
    (oxts / "timestamps.txt").write_text("".join(lines))
    run(tool("run_sequence"), short, "--speed", oxts, "--out", tmp_path)
    metrics = json.loads((tmp_path / short.name / "metrics.json").read_text())
    assert metrics["learned_camera_height_m"] == pytest.approx(CAMERA_HEIGHT, rel=0.05)
