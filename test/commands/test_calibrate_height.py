"""scripts/calibrate_height: the camera's height from drives of known length."""

import re
import shutil

import bags
import cv2
import numpy
import pytest
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
    used, count = map(int, re.search(r"\b(\d+) of (\d+) segments", done.stdout + done.stderr).groups())
    assert count >= 5
    assert used >= count - 1  # the first metres of a drive are the least accurate
    assert_height(height_file)


def test_arguments_reach_the_tool(stub_tools, tmp_path):
    stubs = stub_tools("height_from_drive")
    run(SCRIPTS / "calibrate_height", "a", "--length", 5, **stubs)
    run(SCRIPTS / "calibrate_height", "a", "--out", "o.yaml", "--force", **stubs)
    run(SCRIPTS / "calibrate_height", "a", "--out=o.yaml", **stubs)
    assert (tmp_path / "calls").read_text().splitlines() == [
        "height_from_drive --out height.yaml a --length 5", "height_from_drive a --out o.yaml --force",
        "height_from_drive a --out=o.yaml"]
    assert run(SCRIPTS / "calibrate_height", "fails", check=False, **stubs).returncode == 1


def test_part_of_a_sequence(low, height_file, tmp_path):
    """3 s of the 6 s, of which the first one is not the start of the drive. Images outside them are not read."""
    drive = shutil.copytree(low, tmp_path / "drive")
    for k in (10, 55):
        (drive / f"image_0/{k:06d}.png").write_text("no image")
    positions = numpy.loadtxt(low / "poses.txt")[20:51, 3::4]
    length = numpy.linalg.norm(numpy.diff(positions, axis=0), axis=1).sum()
    run(HEIGHT_FROM_DRIVE, drive, "--from", 2, "--to", 5, "--length", length, "--length-sigma", 0.01, "--out",
        height_file)
    assert height_file.read_text().startswith(f"# From a drive of {length:g} m, known to 0.01 m.\n")
    assert_height(height_file)


def test_bag_with_fixes_replaces_a_file(low_bag, height_file):
    height_file.write_text("camera_height: 1\n")
    done = run(HEIGHT_FROM_DRIVE, "--bag", low_bag, *GPS, "/fix", "--out", height_file, "--force")
    assert "From the fixes on /fix" in done.stdout + done.stderr
    assert_height(height_file)


def test_inaccurate_fixes_need_a_longer_drive(low_bag, height_file):
    """With a standard deviation of 1 m a segment is 40 m long."""
    def less_accurate(topic, message):
        if topic == "/fix":
            message.position_covariance = [1, 0, 0, 0, 1, 0, 0, 0, 4]
        return topic, message

    inaccurate = height_file.with_suffix(".bag")
    bags.copy(low_bag, inaccurate, less_accurate)
    assert_refused(1, "1 segments of the drive can be compared, 4 are needed", HEIGHT_FROM_DRIVE, "--bag", inaccurate, *GPS,
                   "/fix", "--out", height_file)


@pytest.mark.parametrize("topic", [bags.COMPRESSED, bags.COMPRESSED.replace("/compressed", ""),
                                   bags.COMPRESSED.lstrip("/")])
def test_compressed_images(low_bag, height_file, topic):
    compressed = height_file.with_suffix(".bag")
    bags.compress(low_bag, compressed)
    run(HEIGHT_FROM_DRIVE, "--bag", compressed, "--image", topic, "--camera-info", bags.INFO, "--gps",
        "/fix", "--out", height_file)
    assert_height(height_file)


def test_camera_info_beside_compressed_images(low_bag, height_file):
    def beside(topic, message):
        return ("/camera/camera_info" if topic == bags.INFO else topic), message

    compressed, moved = (height_file.with_suffix(suffix) for suffix in (".first", ".bag"))
    bags.compress(low_bag, compressed)
    bags.copy(compressed, moved, beside)
    run(HEIGHT_FROM_DRIVE, "--bag", moved, "--image", bags.COMPRESSED, "--gps", "/fix", "--out",
        height_file)
    assert_height(height_file)


def test_existing_file_is_kept(low, height_file):
    height_file.write_text("camera_height: 1\n")
    assert_refused(1, "exists already", HEIGHT_FROM_DRIVE, low, "--length", 50, "--length-sigma", 0.1,
                   "--out", height_file)
    assert height_file.read_text() == "camera_height: 1\n"


def test_no_such_place(low, height_file):
    file = height_file.parent / "none/height.yaml"
    assert_refused(1, f"there is no folder {file.parent}", HEIGHT_FROM_DRIVE, low, "--length", 50,
                   "--length-sigma", 0.1, "--out", file)


def test_uncertain_height_is_not_written(low, height_file):
    assert_refused(1, "uncertain by", HEIGHT_FROM_DRIVE, low, "--length", 50, "--length-sigma", 5,
                   "--out", height_file)
    assert not height_file.exists()


def test_rectified_images_without_the_option(low_bag, height_file):
    """The camera_info of a raw drive describes the raw camera in K and D, the images in P."""
    raw = height_file.with_suffix(".bag")
    bags.kitti2bag("raw", low_bag, raw)
    topic = "/kitti/camera_gray_left/image_raw"
    drive = ["--bag", raw, "--image", topic, "--length", 50, "--length-sigma", 0.1, "--out",
             height_file]
    assert_refused(1, f"{topic} is used without --rectified, but P of camera_info", HEIGHT_FROM_DRIVE,
                   *drive)
    assert not height_file.exists()


def test_hint_of_raw_images(low_bag, height_file):
    """P equals K: the images may be rectified nevertheless."""
    def distort(topic, message):
        if topic == bags.INFO:
            message.D = [-0.3, 0.1, 0, 0, 0]
        return topic, message

    hint = height_file.with_suffix(".bag")
    bags.copy(low_bag, hint, distort)
    done = run(HEIGHT_FROM_DRIVE, "--bag", hint, *GPS, "/fix", "--rectified", "--out", height_file)
    assert f"{IMAGE} is used with --rectified, but P of camera_info equals K" in done.stderr
    assert_height(height_file)


def test_rejected_image_is_reported(low_bag, height_file):
    images = iter(range(1000))

    def set_back(topic, message):
        if topic == IMAGE and next(images) == 3:
            message.header.stamp.nsecs -= 150000000
        return topic, message

    file = height_file.with_suffix(".bag")
    bags.copy(low_bag, file, set_back)
    done = run(HEIGHT_FROM_DRIVE, "--bag", file, *GPS, "/fix", "--to", 0.5, "--out", height_file, check=False)
    assert "1 images were rejected, the first one because" in done.stderr


def test_no_such_fixes(low_bag, height_file):
    assert_refused(1, "has no fixes on /none", HEIGHT_FROM_DRIVE, "--bag", low_bag, *GPS, "/none",
                   "--to", 0.5, "--out", height_file)
    assert not height_file.exists()


def unknown_position(topic, message):
    if topic == "/fix":
        message.status.status = -1
    return topic, message


def unknown_encoding(topic, message):
    if topic == IMAGE:
        message.encoding = "none"
    return topic, message


def unknown_focal_length(topic, message):
    if topic == bags.INFO:
        message.P = [0.0] * 12
        message.K = [0.0] * 9
    return topic, message


@pytest.mark.parametrize("change, text", [
    (unknown_position, "none of the 60 fixes on /fix has a position"),
    (unknown_encoding, f"no image on {IMAGE} could be used: "),
    (unknown_focal_length, bags.INFO),
])
def test_bag_with_unusable_messages(low_bag, height_file, change, text):
    file = height_file.with_suffix(".bag")
    bags.copy(low_bag, file, change)
    assert_refused(1, text, HEIGHT_FROM_DRIVE, "--bag", file, *GPS, "/fix", "--to", 0.5, "--out", height_file)
    assert not height_file.exists()


def test_bag_that_cannot_be_read(tmp_path, height_file):
    arguments = [*GPS, "/fix", "--out", height_file]
    assert_refused(1, "there is no bag", HEIGHT_FROM_DRIVE, "--bag", tmp_path / "none.bag", *arguments)
    (tmp_path / "text.bag").write_text("text")
    assert_refused(1, "text.bag cannot be read", HEIGHT_FROM_DRIVE, "--bag", tmp_path / "text.bag", *arguments)


def test_raw_images(low, low_bag, height_file):
    """The rectified images have 1.3 times the focal lengths of the raw ones."""
    raw = height_file.with_suffix(".bag")
    to_raw = {}

    def make_raw(topic, message):
        if topic == bags.INFO:
            P = numpy.array(message.P).reshape(3, 4)[:, :3]
            K = P @ numpy.diag([1 / 1.3, 1 / 1.3, 1])
            message.K, to_raw["homography"] = K.ravel().tolist(), K @ numpy.linalg.inv(P)
        elif topic == IMAGE:
            image = numpy.frombuffer(message.data, numpy.uint8).reshape(message.height, message.step)
            message.data = cv2.warpPerspective(image, to_raw["homography"], image.shape[::-1]).tobytes()
            topic = "/kitti/camera_gray_left/image_raw"
        return topic, message

    bags.copy(low_bag, raw, make_raw)
    positions = numpy.loadtxt(low / "poses.txt")[:, 3::4]
    length = numpy.linalg.norm(numpy.diff(positions, axis=0), axis=1).sum()
    run(HEIGHT_FROM_DRIVE, "--bag", raw, "--image", "/kitti/camera_gray_left/image_raw", "--length", length,
        "--length-sigma", 0, "--out", height_file)
    assert_height(height_file)


def test_part_of_a_sequence_with_trajectory(low, height_file):
    run(HEIGHT_FROM_DRIVE, low, "--from", 1, "--trajectory", low / "poses.txt", "--out", height_file)
    assert_height(height_file)


def test_wrong_arguments(low, height_file):
    assert_refused(2, "there is no option foo", HEIGHT_FROM_DRIVE, low, "--length", 50, "--length-sigma", 1, "--out",
                   height_file, "--set", "foo=1")
    assert_refused(2, "one of --length", HEIGHT_FROM_DRIVE, low, "--out", height_file)
    assert_refused(2, "one of --length", HEIGHT_FROM_DRIVE, low, "--length", 50, "--length-sigma", 0.1, "--trajectory",
                   low / "poses.txt", "--out", height_file)
    assert_refused(2, "--length and --length-sigma go together", HEIGHT_FROM_DRIVE, low, "--length",
                   50, "--out", height_file)
    assert_refused(2, "--gps needs --bag", HEIGHT_FROM_DRIVE, low, "--gps", "/fix", "--out",
                   height_file)
    assert_refused(2, "--to must be greater than --from", HEIGHT_FROM_DRIVE, low, "--from", 3,
                   "--to", 2, "--length", 50, "--length-sigma", 1, "--out", height_file)
    assert_refused(2, "one drive", HEIGHT_FROM_DRIVE, "--gps", "/fix", "--out", height_file)
    assert_refused(2, "one drive", HEIGHT_FROM_DRIVE, low, "--bag", "x.bag", "--gps", "/fix", "--out", height_file)
