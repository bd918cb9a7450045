"""scripts/calibrate_height: the camera's height from drives of known length."""

import math
import re
import shutil

import bags
import numpy as np
import pytest
import rosbag
from bags import IMAGE, INFO, RAW_IMAGE
from conftest import SCRIPTS, assert_refused, poses_of, run, write_camera
from sensor_msgs.msg import NavSatStatus

CALIBRATE = SCRIPTS / "calibrate_height"
FIXES = ("--image", IMAGE, "--gps", "/fix")
LENGTH = ("--length", 50, "--length-sigma", 0.1)


@pytest.fixture
def height_file(tmp_path):
    folder = tmp_path / "it's a folder"
    folder.mkdir()
    return folder / "height.yaml"


def assert_height(file):
    """0.6 m, within the accuracy of so short a drive."""
    assert re.search(r"(?m)^camera_height: 0\.[56]", file.read_text())


def length(folder, frames=slice(None)):
    return np.linalg.norm(np.diff(poses_of(folder / "poses.txt")[frames, :, 3], axis=0), axis=1).sum()


def test_sequence_with_trajectory(low, height_file):
    """The default file is in the folder of the user."""
    done = run(CALIBRATE, low, "--trajectory", low / "poses.txt", "--from", 0.5, cwd=height_file.parent)
    used, count = map(int, re.search(r"\b(\d+) of (\d+) segments", done.stdout + done.stderr).groups())
    assert used >= count - 1 >= 3  # the first metres of a drive are the least accurate
    assert_height(height_file)


def test_part_of_a_sequence_with_length(low, height_file, tmp_path):
    """3 s of the 6 s, of which the first one is not the start of the drive. Damaged images outside them do not matter."""
    drive = shutil.copytree(low, tmp_path / "drive")
    for k in (10, 55):
        (drive / f"image_0/{k:06d}.png").write_text("no image")
    height_file.write_text("camera_height: 1\n")
    run(CALIBRATE, drive, "--from", 2, "--to", 5, "--length", length(low, slice(20, 51)), "--length-sigma", 0.01,
        "--out", height_file, "--force")
    assert_height(height_file)


def test_camera_file(low, low_bag, height_file):
    """The height is that of this lens, from a folder and from a bag."""
    camera = write_camera(height_file.with_name("camera.yaml"), low, D=[0.03, 0, 0, 0, 0], readout_time=0.02)
    texts = []
    for drive in ([low, "--camera", camera], [low_bag, "--image", IMAGE, "--camera", camera],
                  [low, "--camera", camera, "--set", "odometry/readout_time=0"], [low]):
        run(CALIBRATE, *drive, *LENGTH, "--out", height_file, "--force")
        texts.append(re.search("(?m)^camera_height: .*", height_file.read_text())[0])
    assert texts[0] == texts[1] and len(set(texts)) == 3, texts


def test_bag_with_compressed_images_and_fixes(low_bag, height_file):
    """The names in the bag have no leading slash, the arguments one."""
    compressed, renamed = height_file.with_suffix(".bag"), height_file.with_name("it's.bag")
    bags.compress(low_bag, compressed)
    names = {bags.COMPRESSED: "camera/jpeg", INFO: "camera/camera_info", "/fix": "fix"}
    bags.copy(compressed, renamed, lambda topic, message: (names.get(topic, topic), message))
    done = run(CALIBRATE, renamed, "--image", "/camera/jpeg", "--gps", "/fix", "--out", height_file)
    assert "From the fixes on /fix" in done.stdout + done.stderr
    assert_height(height_file)


def test_rectified_images_without_the_option(low_bag, height_file):
    """The camera_info of a raw drive describes the raw camera in K and D, the images in P."""
    raw = height_file.with_suffix(".bag")
    bags.raw_drive(low_bag, raw)
    command = (CALIBRATE, raw, "--image", RAW_IMAGE, *LENGTH, "--out", height_file)
    assert_refused(1, "image_is_rectified is false, but P of camera_info", *command)
    assert not height_file.exists()


def test_fixes_of_a_file(low, low_bag, height_file):
    """The first fix is none, and the clock another one, which so short a drive does not determine."""
    fixes = height_file.with_name("track.csv")
    with rosbag.Bag(str(low_bag)) as bag:
        rows = [(fix.header.stamp.to_sec() + 18, fix.latitude, fix.longitude, fix.altitude, 0.02)
                for _, fix, _ in bag.read_messages("/fix")]
    rows[0] = (rows[0][0], 0, 0, 0, 0.02)
    fixes.write_text("stamp,latitude,longitude,altitude,sigma\n" + "".join(",".join(map(repr, row)) + "\n" for row in rows))
    shift = rows[0][0] - np.loadtxt(low / "times.txt")[0]
    command = (CALIBRATE, low, "--gps", fixes, "--out", height_file)
    assert_refused(1, "do not overlap the images'", *command)
    done = run(*command, "--gps-offset", f"{-shift:.9e}")
    assert "59 are used, left out are 1 at 0, 0" in done.stdout
    assert_height(height_file)


def test_fixes_are_read_before_the_drive(low, low_bag, tmp_path):
    for drive, fixes, text in ((low, "track.gpx", "track.gpx: No such file"), (low, "/fix", "FILE.bag:TOPIC"),
                               (low, f"{low_bag}:/gps", "has no fixes on /gps; it holds")):
        done = run(CALIBRATE, drive, "--gps", fixes, check=False, cwd=tmp_path)
        assert (done.returncode, done.stdout) == (1, "") and text in done.stderr, done


@pytest.mark.parametrize("change, text", [
    # With a standard deviation of 1 m a segment is 40 m long.
    ({"position_covariance": [1, 0, 0, 0, 1, 0, 0, 0, 4]}, "1 segments of the drive can be compared, 4 are"),
    ({"position_covariance_type": 0}, "with the assumed 2.5 m (column sigma) a segment is 100 m long"),
    ({"latitude": math.radians, "longitude": math.radians}, "m, on a road vehicle it is 0.2 to 5 m: are the fixes in degrees"),
    # Another drive.
    ({"longitude": lambda degrees: 8 + 1e-4 * math.sin(2e4 * (degrees - 8))}, "do not follow the motion of the images"),
    ({"status": NavSatStatus(status=-1)}, "fixes on /fix: none can be used, of 60 are 60 without a fix"),
])
def test_unusable_fixes(low_bag, height_file, change, text):
    def changed(name, message):
        for field, value in change.items() if name == "/fix" else ():
            setattr(message, field, value(getattr(message, field)) if callable(value) else value)
        return name, message

    file = height_file.with_suffix(".bag")
    bags.copy(low_bag, file, changed)
    assert_refused(1, text, CALIBRATE, file, *FIXES, "--out", height_file)
    assert not height_file.exists()
