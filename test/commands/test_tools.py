"""render_drive, kitti_to_bag, evaluate_bag, graph_observer, screenshot: arguments, damaged data, existing
files, full disks."""

import os

import pytest
from bags import IMAGE, copy, write_drive
from conftest import SCRIPTS, assert_refused, on_full_disk, run, tool

RENDER_DRIVE, KITTI_TO_BAG, EVALUATE_BAG = map(tool, ("render_drive", "kitti_to_bag", "evaluate_bag"))


def test_render_drive_no_such_scenario(tmp_path):
    assert_refused(2, "unknown scenario", RENDER_DRIVE, "--scenario", "none", tmp_path / "x")


def test_render_drive_full_disk(tmp_path):
    assert_refused(1, "cannot be written, File too large", RENDER_DRIVE, "--frames", 2,
                   tmp_path / "drive", **on_full_disk(10))
    assert list(tmp_path.iterdir()) == []


def test_kitti_to_bag_no_such_folder(tmp_path):
    assert_refused(1, f"{tmp_path}/none", KITTI_TO_BAG, tmp_path / "none", "--out", tmp_path / "x.bag")


def test_kitti_to_bag_no_such_place(short, tmp_path):
    file = tmp_path / "none/x.bag"
    assert_refused(1, f"{file}: cannot be written, there is no folder {file.parent}", KITTI_TO_BAG, short,
                   "--out", file)


def test_kitti_to_bag_frames(short, tmp_path):
    assert_refused(1, "has frames 0 to 39", KITTI_TO_BAG, short, "--out", tmp_path / "x.bag",
                   "--start", 40)


def test_kitti_to_bag_damaged_folder(damaged_folder, tmp_path):
    folder, reason = damaged_folder
    assert_refused(1, reason, KITTI_TO_BAG, folder, "--out", tmp_path / "x.bag")
    assert list(tmp_path.iterdir()) == []


def test_kitti_to_bag_keeps_an_existing_file(shortest, tmp_path):
    file = tmp_path / "x.bag"
    file.write_text("other data")
    assert_refused(1, f"{file} exists already; --force", KITTI_TO_BAG, shortest, "--out", file)
    assert file.read_text() == "other data"
    run(KITTI_TO_BAG, shortest, "--out", file, "--force")
    assert file.read_bytes().startswith(b"#ROSBAG")


def test_kitti_to_bag_never_replaces_a_device(shortest, tmp_path):
    device = tmp_path / "pipe"  # any file that is not a regular one
    os.mkfifo(device)
    assert_refused(1, f"{device} is not a regular file", KITTI_TO_BAG, shortest, "--out", device,
                   "--force")
    assert device.is_fifo()


def test_graph_observer_keeps_an_existing_file(tmp_path):
    file = tmp_path / "x.csv"
    file.write_text("other data")
    assert_refused(1, f"{file} exists already; --force", tool("graph_observer"), "--out", file)
    assert file.read_text() == "other data"


def test_screenshot_keeps_an_existing_file(tmp_path):
    file = tmp_path / "x.png"
    file.write_text("other data")
    assert_refused(1, f"{file} exists already; --force", SCRIPTS / "screenshot", "--out", file)


def test_kitti_to_bag_full_disk(short, tmp_path):
    assert_refused(1, "x.bag cannot be written", KITTI_TO_BAG, short, "--out", tmp_path / "x.bag",
                   **on_full_disk(100))
    assert list(tmp_path.iterdir()) == []


def test_evaluate_bag_damaged(damaged_bag, bag, tmp_path):
    assert_refused(1, str(damaged_bag), EVALUATE_BAG, "--played", damaged_bag, "--recorded", bag,
                   "--out", tmp_path, "--camera-height", 1.65, "--image", IMAGE)


def test_evaluate_bag_with_two_image_topics(bag, tmp_path):
    images = iter(range(1000))

    def spread(topic, message):
        return (IMAGE.replace("_rect", "_raw") if topic == IMAGE and next(images) % 2 else topic), message

    played = tmp_path / "two.bag"
    copy(bag, played, spread)
    assert_refused(1, f"the bag {played} has images on {IMAGE} and {IMAGE.replace('_rect', '_raw')}: "
                   "choose one with --image", EVALUATE_BAG, "--played", played, "--recorded", bag,
                   "--out", tmp_path, "--camera-height", 1.65)


@pytest.mark.parametrize("factor", [1.0, 1.42])
def test_evaluate_bag_reports_a_scale_that_is_never_within_2_sigma(factor, tmp_path):
    played, recorded = tmp_path / "played.bag", tmp_path / "recorded.bag"
    write_drive(played, recorded, factor)
    done = run(EVALUATE_BAG, "--played", played, "--recorded", recorded, "--out", tmp_path / "out",
               "--camera-height", 1.65)
    text = "in no frame is the scale within two standard deviations of the ground truth"
    assert (text in done.stderr) == (factor != 1), done.stderr
    assert factor == 1 or "median error +42.0 %" in done.stderr


def test_evaluate_bag_with_a_slash_before_the_frame_of_the_images(tmp_path):
    """The nodelets omit it; the poses remain those of the camera, forward along z."""
    def slash(topic, message):
        if topic == IMAGE:
            message.header.frame_id = "/camera"
        return topic, message

    drive, played, recorded = (tmp_path / f"{name}.bag" for name in ("drive", "played", "recorded"))
    write_drive(drive, recorded, 1)
    copy(drive, played, slash)
    run(EVALUATE_BAG, "--played", played, "--recorded", recorded, "--out", tmp_path / "out",
        "--camera-height", 1.65)
    last = (tmp_path / "out/poses.txt").read_text().splitlines()[-1].split()
    assert [round(float(last[k])) for k in (3, 7, 11)] == [0, 0, 99]


def test_evaluate_bag_no_such_bag(bag, tmp_path):
    assert_refused(1, "there is no bag", EVALUATE_BAG, "--played", tmp_path / "none.bag", "--recorded",
                   bag, "--out", tmp_path, "--camera-height", 1.65)
