"""scripts/calibrate_height: the camera's height from drives of known length."""

import re

import pytest
import bags
from bags import IMAGE
from conftest import SCRIPTS, assert_refused, run, tool

HEIGHT_FROM_DRIVE = tool("height_from_drive")
GPS = ["--image", IMAGE, "--gps"]


@pytest.fixture
def height_file(tmp_path):
    return tmp_path / "height.yaml"


def assert_height(file):
    """0.6 m, within the accuracy of so short a drive."""
    assert re.search(r"(?m)^camera_height: 0\.[56]", file.read_text())


def test_sequence_with_trajectory(low, height_file):
    done = run(SCRIPTS / "calibrate_height", low, "--trajectory", low / "poses.txt", "--out",
               height_file)
    assert re.search(r"\b(\d+) of \1 segments", done.stdout + done.stderr)
    assert_height(height_file)


def test_bag_with_fixes_replaces_a_file(low_bag, height_file):
    height_file.write_text("camera_height: 1\n")
    done = run(HEIGHT_FROM_DRIVE, "--bag", low_bag, *GPS, "/fix", "--out", height_file, "--force")
    assert "From the fixes on /fix" in done.stdout + done.stderr
    assert_height(height_file)


@pytest.mark.parametrize("topic", [bags.COMPRESSED, bags.COMPRESSED.replace("/compressed", ""),
                                   bags.COMPRESSED.lstrip("/")])
def test_compressed_images(low_bag, height_file, topic):
    compressed = height_file.with_suffix(".bag")
    bags.compress(low_bag, compressed)
    run(HEIGHT_FROM_DRIVE, "--bag", compressed, "--image", topic, "--camera-info", bags.INFO, "--gps",
        "/fix", "--out", height_file)
    assert_height(height_file)


def test_existing_file_is_kept(low, height_file):
    height_file.write_text("camera_height: 1\n")
    assert_refused(1, "exists already", HEIGHT_FROM_DRIVE, low, "--length", 50, "--length-sigma", 0.1,
                   "--out", height_file)
    assert height_file.read_text() == "camera_height: 1\n"


def test_uncertain_height_is_not_written(low, height_file):
    assert_refused(1, "uncertain by", HEIGHT_FROM_DRIVE, low, "--length", 50, "--length-sigma", 5,
                   "--out", height_file)
    assert not height_file.exists()


def test_no_such_fixes(low_bag, height_file):
    assert_refused(1, "has no fixes on /none", HEIGHT_FROM_DRIVE, "--bag", low_bag, *GPS, "/none",
                   "--to", 0.5, "--out", height_file)
    assert not height_file.exists()


def test_wrong_arguments(low, height_file):
    assert_refused(2, "one of --length", HEIGHT_FROM_DRIVE, low, "--out", height_file)
    assert_refused(2, "one drive", HEIGHT_FROM_DRIVE, "--gps", "/fix", "--out", height_file)
