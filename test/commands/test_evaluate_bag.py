"""evaluate_bag: the metrics of what the nodelets have published, as scripts/demo calls it."""

import csv
import json

import numpy as np
import pytest
import rosbag
import rospy
from bags import IMAGE, RAW_IMAGE, write_drive
from conftest import assert_refused, poses_of, run, tool
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from ground_scale_vo.msg import ScaleEstimate

EVALUATE_BAG = tool("evaluate_bag")
WRONG_SCALE = "in no frame is the scale within two standard deviations"
# Variance [m^2] of a camera that moves along z, and of a base with the heading YAW.
YAW = 0.7
TURNED = np.array([[np.cos(YAW), -np.sin(YAW), 0], [np.sin(YAW), np.cos(YAW), 0], [0, 0, 1]])
VARIANCE = {"camera": np.diag([1e-6, 1e-6, 0.01]), "base_link": TURNED @ np.diag([0.01, 1e-6, 1e-6]) @ TURNED.T}


@pytest.fixture
def bags(tmp_path):
    return tmp_path / "played.bag", tmp_path / "recorded.bag"


def arguments(bags):
    return "--played", bags[0], "--recorded", bags[1], "--out", bags[0].parent / "out", "--camera-height", 1.2


def evaluated(bags):
    """The output, the metrics and the result folder."""
    done, out = run(EVALUATE_BAG, *arguments(bags)), bags[0].parent / "out"
    return done, json.loads((out / "metrics.json").read_text()), out


@pytest.mark.parametrize("frame, yaw, true_yaw", [("camera", 0, 0), ("base_link", YAW, -0.4)])
def test_metrics_of_a_drive(bags, frame, yaw, true_yaw):
    """In odom frame and ground truth a base is turned differently. Both trajectories begin at the identity and
    go ahead along z of a camera. The error of 4 % of each metre has a standard deviation of 0.1 m along the
    motion, 1 mm across it."""
    def change(topic, message, i):
        if topic == "/odometry":
            covariance = np.zeros((6, 6))
            covariance[:3, :3], covariance[3:, 3:] = VARIANCE[frame], 1e-12 * np.eye(3)
            message.pose.covariance = ((1 + i) * covariance).ravel().tolist()
        elif topic == IMAGE:  # the nodelets omit the slash
            message.header.frame_id = "/camera"
        return True

    write_drive(*bags, 1.04, frame, yaw, true_yaw, change)
    with rosbag.Bag(str(bags[1]), "a") as bag:  # by each nodelet after another frame
        for name, value, i in (("mono_vo: odometry", "7.5", 50), ("scale_recovery: scale", "2.5", 53)):
            status = DiagnosticStatus(name=name, values=[KeyValue("time of the last frame [ms]", value)])
            bag.write("/diagnostics", DiagnosticArray(status=[status]), rospy.Time(1000.001 + 0.1 * i))
    done, metrics, out = evaluated(bags)
    assert "100 images in, 100 frames out of both nodelets, 0 lost" in done.stdout
    assert WRONG_SCALE in done.stderr
    for name, length in (("poses", 1.04 * 99), ("ground_truth", 99)):
        expected = np.hstack([np.eye(3), [[0], [0], [length]]])
        assert poses_of(out / f"{name}.txt")[-1] == pytest.approx(expected, abs=1e-4)
    assert metrics["frames"] == metrics["tracked_frames"] == 100 and metrics["camera_height_m"] == 1.2
    assert metrics["rle_percent"] == pytest.approx(4)
    nees = metrics["covariance_by_length"][0]["nees_per_dof"]  # with that of the ground truth
    assert nees == pytest.approx((0.04 * 11) ** 2 / (11 * 0.01 + 2 * 0.05 ** 2) / 6, rel=0.05)
    assert [metrics[f"ms_{name}_median"] for name in ("vo", "scale", "total")] == [7.5, 2.5, 10]


@pytest.mark.parametrize("last_truth, first_pose, frames, length", [
    (95, 0, 96, 95), (89, 0, 100, None), (96, 98, 2, None)])
def test_without_the_last_ground_truth(bags, last_truth, first_pose, frames, length):
    """The images have 10 Hz; without the last half second the drive is evaluated up to there."""
    write_drive(*bags, change=lambda topic, _, i: (topic != "/tf" or i <= last_truth) and
                (topic != "/odometry" or i >= first_pose))
    _, metrics, out = evaluated(bags)
    assert metrics["frames"] == len(poses_of(out / "poses.txt")) == frames
    assert metrics["gt_length_m"] == (length and pytest.approx(length))


def test_lost_frames(bags):
    """They are of the map of the next frame, or of the last one: the map changes at frame 51."""
    def change(topic, message, i):
        if topic == "/scale":
            message.map_id = 3 if i < 51 else 4
            return i not in (20, 51, 52, 99)
        if topic == "/vo/odometry":
            message.pose.pose.position.z -= 51 if i >= 51 else 0
            return i not in (30, 31)
        return True

    write_drive(*bags, change=change)
    done, metrics, out = evaluated(bags)
    assert "100 images in, 96 frames out of both nodelets, 4 lost on the way" in done.stdout
    assert WRONG_SCALE not in done.stderr
    # Between two maps there is no step.
    assert poses_of(out / "poses_unscaled.txt")[-1, 2, 3] == pytest.approx(98)
    assert (metrics["tracked_frames"], metrics["lost_events"]) == (98, 1)
    with open(out / "scale.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [i for i, row in enumerate(rows) if row["vo_status"] == "lost"] == [30, 31]
    assert [i for i, row in enumerate(rows) if (row["status"], row["scale"]) == ("unknown", "0")] == [20, 51, 52, 99]
    assert [row["map_id"] for row in rows] == 51 * ["3"] + 49 * ["4"]


@pytest.mark.parametrize("status, reason", [
    (ScaleEstimate.UNKNOWN, "the scale was never known"), (ScaleEstimate.HELD, "tf had no transform from the base")])
def test_without_a_metric_pose(bags, status, reason):
    def change(topic, message, _):
        if topic == "/scale":
            message.status = status
        return topic != "/odometry"

    write_drive(*bags, change=change)
    assert_refused(1, reason, EVALUATE_BAG, *arguments(bags))


def test_two_image_topics(bags):
    write_drive(*bags)
    with rosbag.Bag(str(bags[0]), "a") as bag:
        bag.write(RAW_IMAGE, next(bag.read_messages(topics=[IMAGE]))[1], rospy.Time(1000.05))
    assert_refused(1, f"has images on {IMAGE} and {RAW_IMAGE}: choose one", EVALUATE_BAG, *arguments(bags))


def test_damaged_bag(bags, damaged_bag, bag):
    assert_refused(1, str(damaged_bag), EVALUATE_BAG, *arguments((damaged_bag, bag)), "--image", IMAGE)
