"""Speeds of the vehicle: `run`, `run_sequence --speed` and Python, all three with the same result."""

import csv
import json

import numpy as np
import pytest
from conftest import CAMERA_HEIGHT, assert_refused, poses_of, run, tool


@pytest.fixture(scope="module")
def speeds(short, tmp_path_factory):
    """A CSV with the speeds of the ground truth."""
    stamps, positions = np.loadtxt(short / "times.txt"), poses_of(short / "poses.txt")[:, :3, 3]
    path = np.append(0, np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1)))
    file = tmp_path_factory.mktemp("speed") / "speed.csv"
    rows = zip(stamps, np.gradient(path, stamps))
    file.write_text("stamp,speed\n" + "".join(f"{stamp:.9f},{speed:.4f}\n" for stamp, speed in rows))
    return file


def test_height_is_learned_through_all_doors(gsv, venv, short, speeds, tmp_path):
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
        odometry.add_speed(round(1e9 * float(row["stamp"])), float(row["speed"]))
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
    (1, "line 1: a heading with the columns stamp and speed is expected", "time,speed\n0,1\n"),
    (1, "line 3: has 1 columns instead of 2", "stamp,speed\n0,1\n1\n"),
    (1, "line 2: 'fast' is not a finite number", "stamp,speed\n0,fast\n"),
    (1, "line 3: the stamp is not later", "stamp,speed\n1,1\n1,2\n"),
    (1, "line 2: the stamp is not one in seconds", "stamp,speed\n1317013370123456789,1\n"),
    (1, "has no speed", "stamp,speed\n"),
])
def test_refused_speeds(short, tmp_path, status, text, content):
    file = tmp_path / "speed.csv"
    words = [] if content is None else ["--speed", file]
    if content is not None:
        file.write_text(content)
    assert_refused(status, text, tool("run_sequence"), short, "--out", tmp_path / "out", *words)


def test_stamps_of_another_clock_are_named(short, tmp_path):
    file = tmp_path / "speed.csv"
    file.write_text("stamp,speed\n1000,8\n1001,8\n")
    done = run(tool("run_sequence"), short, "--camera-height", CAMERA_HEIGHT, "--speed", file, "--out", tmp_path)
    assert "no speed is used: the images are from 0.0" in done.stderr


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
