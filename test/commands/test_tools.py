"""render_drive, kitti_to_bag, evaluate_bag, graph_observer, screenshot: arguments, damaged data, existing
files, full disks."""

import csv
import json
import os
import shutil

import cv2
import numpy as np
import pytest
import rosbag
import rospy
from bags import IMAGE, INFO, copy, write_drive
from conftest import SCRIPTS, assert_refused, on_full_disk, run, tool
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from ground_scale_vo.msg import ScaleEstimate

RENDER_DRIVE, KITTI_TO_BAG, EVALUATE_BAG = map(tool, ("render_drive", "kitti_to_bag", "evaluate_bag"))


def test_render_drive_no_such_scenario(tmp_path):
    assert_refused(2, "unknown scenario", RENDER_DRIVE, "--scenario", "none", tmp_path / "x")


def rendered(folder, *arguments, frames=2, size="200x62"):
    """times.txt, poses.txt and ground.txt of a drive with images of a quarter of the size."""
    run(RENDER_DRIVE, "--frames", frames, "--size", size, *arguments, folder)
    return (np.loadtxt(folder / name) for name in ("times.txt", "poses.txt", "ground.txt"))


def camera_matrix(folder):
    return np.array((folder / "calib.txt").read_text().split()[1:], float).reshape(3, 4)[:, :3]


def test_render_drive_options(short, tmp_path):
    drive = ("--camera-height", 2, "--speed", 5, "--rate", 20, "--pitch", 0, "--curvature", 0, "--slope", 0)
    times, poses, ground = rendered(tmp_path / "a", *drive, "--suspension", 0)
    K, whole = camera_matrix(tmp_path / "a"), camera_matrix(short)
    assert K[[0, 1], [0, 1]] == pytest.approx(whole[[0, 1], [0, 1]] / 4)
    assert K[:2, 2] == pytest.approx((whole[:2, 2] + 0.5) / 4 - 0.5)  # (0, 0) is the centre of a pixel
    rendered(tmp_path / "square", size="100x100", frames=1)
    assert camera_matrix(tmp_path / "square")[:2, 2] == pytest.approx((whole[:2, 2] + 0.5) * [1 / 8, 100 / 248] - 0.5)
    assert times == pytest.approx([0, 0.05])
    assert poses[1] == pytest.approx([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0.25])
    assert ground == pytest.approx(np.array([[2, 0, -1, 0]] * 2))


def test_render_drive_seed(tmp_path):
    def image(seed):
        rendered(tmp_path / str(seed), "--seed", seed)
        return (tmp_path / f"{seed}/image_0/000001.png").read_bytes()

    assert image(1) != image(2)


def images(folder):
    return [cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) for file in sorted((folder / "image_0").iterdir())]


def test_render_drive_black_images(tmp_path):
    rendered(tmp_path / "a", "--black-first", 3, "--black-frames", 2, frames=6)
    assert [bool(image.mean() < 20) for image in images(tmp_path / "a")] == 3 * [False] + 2 * [True] + [False]


def test_render_drive_stop(tmp_path):
    """From 5 m/s to a standstill of 2 s after 10 m."""
    times, poses, _ = rendered(tmp_path / "a", "--speed", 5, "--stop", 2, "--stop-at", 10, frames=60,
                               size="48x16")
    forward = poses.reshape(-1, 3, 4)[:, 2, 3]
    standing = np.flatnonzero(np.diff(forward) < 1e-3)
    assert np.ptp(times[standing]) == pytest.approx(2, abs=0.3)
    assert forward[standing] == pytest.approx(10, abs=0.5)


def test_render_drive_appearance(tmp_path):
    def pixels(*options):
        folder = tmp_path / "".join(map(str, options))
        rendered(folder, "--suspension", 0, *options)
        return np.array(images(folder), float)

    def roughness(drive):
        """Of the road."""
        return np.median(abs(np.diff(drive[:, 40:], axis=2)))

    default = pixels("--noise", 0)
    shadows, markings, cars, smooth = (pixels("--noise", 0, *options) - default for options in (
        ["--no-shadows"], ["--no-lane-markings"], ["--no-moving-cars"], ["--road-texture", 0]))
    assert shadows.min() > -5 and (shadows > 5).mean() > 0.05
    assert markings.max() < 5 and (markings < -5).mean() > 0.01
    assert 0 < (abs(cars) > 5).mean() < 0.05 and abs(cars[:, :30]).max() > 5  # also above the horizon
    assert roughness(default + smooth) < 0.5 < roughness(default)
    assert (pixels("--noise", 20) - default).std() == pytest.approx(20, rel=0.1)


def test_rendered_ground_agrees_with_the_poses(short):
    """The camera rises by the part of its motion along the road's normal; the suspension moves it."""
    ground = np.loadtxt(short / "ground.txt")
    poses = np.loadtxt(short / "poses.txt").reshape(-1, 3, 4)
    steps = np.einsum("nji,nj->ni", poses[:-1, :, :3], np.diff(poses[:, :, 3], axis=0))
    rise = np.einsum("ni,ni->n", ground[:-1, 1:], steps)
    assert np.ptp(ground[:, 0]) > 0.005 and np.all(ground[:, 2] < -0.9)
    assert np.allclose(np.diff(ground[:, 0]), rise, atol=1e-3)


def test_derive_drives_cameras(shortest, tmp_path):
    names = ("half", "crop640", "roll8", "roll15", "pitch20")
    run(tool("derive_drives"), shortest, *names, "--out", tmp_path)
    whole = camera_matrix(shortest)
    K = {name: camera_matrix(tmp_path / f"shortest_{name}") for name in names}
    assert K["half"][[0, 1], [0, 1]] == pytest.approx(whole[[0, 1], [0, 1]] / 2)
    assert K["half"][:2, 2] == pytest.approx((whole[:2, 2] + 0.5) / 2 - 0.5)  # (0, 0) is the centre of a pixel
    assert K["crop640"] == pytest.approx(whole - [[0, 0, 80], [0, 0, 0], [0, 0, 0]])
    normal = np.loadtxt(shortest / "ground.txt")[0, 1:]
    for name, rotation in (("roll8", (0, 0, 8)), ("roll15", (0, 0, 15)), ("pitch20", (20, 0, 0))):
        derived = np.loadtxt(tmp_path / f"shortest_{name}/ground.txt")[0, 1:]
        turned_normal = cv2.Rodrigues(np.radians(rotation))[0] @ normal
        assert derived == pytest.approx(turned_normal, abs=1e-6), name
        height, width = images(tmp_path / f"shortest_{name}")[0].shape
        assert K[name][[0, 1], [0, 1]] == pytest.approx(whole[[0, 1], [0, 1]])
        shift = whole[:2, 2] - K[name][:2, 2]
        assert np.all(shift >= 0) and np.all(shift + [width, height] <= [800, 248]), name


def test_derive_drives_images(shortest, tmp_path):
    interrupted = tmp_path / "shortest_every3.partial/image_0/000020.png"
    interrupted.parent.mkdir(parents=True)
    interrupted.touch()
    run(tool("derive_drives"), shortest, "every3", "jpeg20", "dark", "--out", tmp_path)
    given, every3 = images(shortest), images(tmp_path / "shortest_every3")
    assert len(every3) == 4 and all(np.array_equal(image, given[3 * i]) for i, image in enumerate(every3))
    _, expected = cv2.imencode(".jpg", given[5], [cv2.IMWRITE_JPEG_QUALITY, 20])
    assert (tmp_path / "shortest_jpeg20/image_0/000005.jpg").read_bytes() == expected.tobytes()
    signal = np.array(given) / 4
    noise = np.array(images(tmp_path / "shortest_dark")) - signal
    variance = signal / 2 + 3**2  # of photons, and of the sensor
    noise /= np.sqrt(variance)
    assert noise[signal > 20].std() == pytest.approx(1, rel=0.02)
    bright = (signal[0] > 20) & (signal[1] > 20)
    assert abs(np.corrcoef(noise[0][bright], noise[1][bright])[0, 1]) < 0.05  # new in each image


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


def rotation_matrix(q):
    """Of a quaternion."""
    axis = np.array([q.x, q.y, q.z])
    cross = np.cross(np.eye(3), axis)
    return np.eye(3) + 2 * q.w * cross + 2 * cross @ cross


@pytest.mark.parametrize("style, start, parent, child", [
    ("native", 5.5, "ground_truth", "ground_truth/camera_gray_left"),
    ("kitti2bag", 0, "world", "camera_left"),
])
def test_kitti_to_bag_contents(shortest, tmp_path, style, start, parent, child):
    """A stamp of 0 means no stamp in ROS, so these bags begin at 1 s."""
    sequence, file = tmp_path / "sequence", tmp_path / "x.bag"
    shutil.copytree(shortest, sequence)
    stamps = start + np.loadtxt(shortest / "times.txt")
    np.savetxt(sequence / "times.txt", stamps)
    turned = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0], [0.48, 0.64, 0.6]])
    poses = [np.hstack([np.linalg.matrix_power(turned, i), [[i], [2 * i], [3 * i]]]) for i in range(12)]
    np.savetxt(sequence / "poses.txt", [pose.ravel() for pose in poses])
    run(KITTI_TO_BAG, sequence, "--out", file, "--style", style, "--start", 2, "--end", 5)
    messages = {}
    with rosbag.Bag(str(file)) as bag:
        for topic, message, _ in bag.read_messages():
            messages.setdefault(topic, []).append(message)
    assert set(messages) == {IMAGE, INFO, "/tf"} and [len(m) for m in messages.values()] == [4, 4, 4]
    K = camera_matrix(shortest)
    for i, image, info, tf in zip(range(2, 6), messages[IMAGE], messages[INFO], messages["/tf"]):
        transform, = tf.transforms
        for header in (image.header, info.header, transform.header):
            assert header.stamp.to_sec() == pytest.approx(stamps[i] + (0 if start else 1))
        assert image.header.frame_id == info.header.frame_id == "camera_gray_left"
        assert (transform.header.frame_id, transform.child_frame_id) == (parent, child)
        t = transform.transform.translation
        assert [t.x, t.y, t.z] == pytest.approx([i, 2 * i, 3 * i])
        assert rotation_matrix(transform.transform.rotation) == pytest.approx(poses[i][:, :3], abs=1e-6)
        assert np.array(info.P).reshape(3, 4)[:, :3] == pytest.approx(K)
        assert any(info.K) == (style == "native")
        pixels = np.frombuffer(image.data, np.uint8).reshape(image.height, image.step)
        assert np.array_equal(pixels, images(shortest)[i])


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


def test_baseline_tracks_as_many_points_as_the_odometry(shortest, tmp_path):
    run(tool("benchmark_sequence"), shortest, "--camera-height", 1.65, "--baseline", "--out", tmp_path)
    usage, baseline = (np.genfromtxt(tmp_path / name, delimiter=",", names=True)
                       for name in ("usage.csv", "baseline.csv"))
    assert np.array_equal(baseline["points"], usage["features"][1:]) and baseline["points"].min() > 100


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


def turned(yaw):
    """Rotation matrix about z."""
    return np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])


def write_base_drive(played, recorded, yaw=0.7, factor=1.0, missing_truth=0, missing_poses=0):
    """As write_drive(), but of a base_link, straight ahead along its x axis, in an odom frame and a ground
    truth that are turned differently. The covariance grows along the motion only. The last ground truths
    and the first metric poses may be missing."""
    ahead, true_ahead = turned(yaw) @ [1, 0, 0], turned(-0.4) @ [1, 0, 0]
    variance = np.zeros((6, 6))
    variance[:3, :3] = turned(yaw) @ np.diag([0.01, 1e-6, 1e-6]) @ turned(yaw).T
    variance[3:, 3:] = 1e-12 * np.eye(3)
    write_drive(played.with_suffix(".first"), recorded.with_suffix(".first"), factor)

    def set_pose(position, orientation, p, heading):
        position.x, position.y, position.z = p
        orientation.x = orientation.y = 0
        orientation.z, orientation.w = np.sin(heading / 2), np.cos(heading / 2)

    images = iter(range(1000))

    def change_played(topic, message):
        if topic != "/tf":
            return topic, message
        i, transform = next(images), message.transforms[0]
        transform.child_frame_id = "ground_truth/base_link"
        set_pose(transform.transform.translation, transform.transform.rotation, i * true_ahead, -0.4)
        return None if i >= 100 - missing_truth else (topic, message)

    frames = iter(range(1000))

    def change_recorded(topic, message):
        if topic == "/scale":
            message.map_id = 3
        if topic == "/odometry":
            i = next(frames)
            message.child_frame_id = "base_link"
            set_pose(message.pose.pose.position, message.pose.pose.orientation, factor * i * ahead, yaw)
            message.pose.covariance = ((1 + i) * variance).ravel().tolist()
            return None if i < missing_poses else (topic, message)
        return topic, message

    copy(played.with_suffix(".first"), played, change_played)
    copy(recorded.with_suffix(".first"), recorded, change_recorded)


def evaluated_drive(tmp_path, **options):
    """Standard output, metrics and result folder of evaluate_bag for write_base_drive()."""
    played, recorded, out = (tmp_path / name for name in ("played.bag", "recorded.bag", "out"))
    write_base_drive(played, recorded, **options)
    with rosbag.Bag(str(recorded)) as bag:
        times = [time for _, _, time in bag.read_messages(topics=["/scale"])]
    with rosbag.Bag(str(recorded), "a") as bag:  # by each nodelet after another frame
        for name, value, time in (("mono_vo: odometry", "7.5", times[50]), ("scale_recovery: scale", "2.5", times[53])):
            bag.write("/diagnostics", DiagnosticArray(status=[DiagnosticStatus(
                name=name, values=[KeyValue("time of the last frame [ms]", value)])]), time + rospy.Duration(0.001))
    done = run(EVALUATE_BAG, "--played", played, "--recorded", recorded, "--out", out, "--camera-height", 1.2)
    return done.stdout, json.loads((out / "metrics.json").read_text()), out


def test_evaluate_bag_whose_first_pose_is_after_its_ground_truth(tmp_path):
    output, metrics, out = evaluated_drive(tmp_path, missing_truth=3, missing_poses=98)
    assert metrics["frames"] == 2 and metrics["rle_percent"] is None and "not evaluated" not in output
    assert len(np.loadtxt(out / "poses.txt")) == 2 and not (out / "ground_truth.txt").exists()


def test_evaluate_bag_of_a_base_in_turned_frames(tmp_path):
    """Both trajectories begin at the identity and go ahead along z of a camera. The error of 4 % of each
    metre has a standard deviation of 0.1 m along the motion, 1 mm across it."""
    output, metrics, out = evaluated_drive(tmp_path, factor=1.04)
    assert "100 images in, 100 frames out of both nodelets, 0 lost" in output
    for name, length in (("poses", 1.04 * 99), ("ground_truth", 99)):
        pose = np.loadtxt(out / f"{name}.txt")[-1].reshape(3, 4)
        assert pose == pytest.approx(np.hstack([np.eye(3), [[0], [0], [length]]]), abs=1e-4)
    assert metrics["frames"] == metrics["tracked_frames"] == 100 and metrics["camera_height_m"] == 1.2
    assert metrics["rle_percent"] == pytest.approx(4)
    nees = metrics["covariance_by_length"][0]["nees_per_dof_exact_ground_truth"]
    assert nees == pytest.approx((0.04 * 11) ** 2 / (11 * 0.01) / 6, rel=0.05)
    assert [metrics[f"ms_{name}_median"] for name in ("vo", "scale", "total")] == [7.5, 2.5, 10]
    assert ",3,tracking" in (out / "scale.csv").read_text().splitlines()[-1]


def test_evaluate_bag_covariance_of_a_camera(tmp_path):
    """It grows along z, the direction of motion, as in test_evaluate_bag_of_a_base_in_turned_frames."""
    frames = iter(range(1000))

    def set_covariance(topic, message):
        if topic == "/odometry":
            variance = np.diag([1e-6, 1e-6, 0.01, 1e-12, 1e-12, 1e-12])
            message.pose.covariance = ((1 + next(frames)) * variance).ravel().tolist()
        return topic, message

    drive, played, recorded = (tmp_path / f"{name}.bag" for name in ("drive", "played", "recorded"))
    write_drive(played, drive, 1.04)
    copy(drive, recorded, set_covariance)
    run(EVALUATE_BAG, "--played", played, "--recorded", recorded, "--out", tmp_path / "out",
        "--camera-height", 1.65)
    metrics = json.loads((tmp_path / "out/metrics.json").read_text())
    nees = metrics["covariance_by_length"][0]["nees_per_dof_exact_ground_truth"]
    assert nees == pytest.approx((0.04 * 11) ** 2 / (11 * 0.01) / 6, rel=0.05)


@pytest.mark.parametrize("missing, frames", [(4, 96), (10, 100)])
def test_evaluate_bag_without_the_last_ground_truth(tmp_path, missing, frames):
    """The images have 10 Hz; without the last half second the drive is evaluated up to there."""
    output, metrics, _ = evaluated_drive(tmp_path, missing_truth=missing)
    assert metrics["frames"] == frames
    assert metrics["gt_length_m"] == (pytest.approx(95) if missing == 4 else None)
    assert f"covers only {100 - missing} of 100 frames" in output or missing == 4


def test_evaluate_bag_counts_lost_frames(tmp_path):
    """They are of the map of the next frame, or of the last one: the map changes at frame 51."""
    scales, unscaled = iter(range(1000)), iter(range(1000))

    def drop(topic, message):
        if topic == "/scale":
            i = next(scales)
            message.map_id = 3 if i < 51 else 4
            return None if i in (20, 51, 52, 99) else (topic, message)
        if topic == "/vo/odometry":
            i = next(unscaled)
            message.pose.pose.position.z -= 51 if i >= 51 else 0
            return None if i in (30, 31) else (topic, message)
        return topic, message

    drive, played, recorded = (tmp_path / f"{name}.bag" for name in ("drive", "played", "recorded"))
    write_drive(played, drive, 1)
    copy(drive, recorded, drop)
    done = run(EVALUATE_BAG, "--played", played, "--recorded", recorded, "--out", tmp_path / "out",
               "--camera-height", 1.65)
    assert "100 images in, 96 frames out of both nodelets, 4 lost on the way" in done.stdout
    # Between two maps there is no step.
    assert np.loadtxt(tmp_path / "out/poses_unscaled.txt")[-1, 11] == pytest.approx(98)
    metrics = json.loads((tmp_path / "out/metrics.json").read_text())
    assert (metrics["tracked_frames"], metrics["lost_events"]) == (98, 1)
    with open(tmp_path / "out/scale.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [i for i, row in enumerate(rows) if row["vo_status"] == "lost"] == [30, 31]
    assert [i for i, row in enumerate(rows) if (row["status"], row["scale"]) == ("unknown", "0")] == [20, 51, 52, 99]


@pytest.mark.parametrize("status, reason", [
    (ScaleEstimate.UNKNOWN, ": the scale was never known"),
    (ScaleEstimate.HELD, ", although the scale is known: tf had no transform from the base frame to camera")])
def test_evaluate_bag_without_a_metric_pose(tmp_path, status, reason):
    def change(topic, message):
        if topic == "/scale":
            message.status = status
        return None if topic == "/odometry" else (topic, message)

    drive, played, recorded = (tmp_path / f"{name}.bag" for name in ("drive", "played", "recorded"))
    write_drive(played, drive, 1)
    copy(drive, recorded, change)
    assert_refused(1, f"no image of {played} has a metric pose in {recorded}{reason}", EVALUATE_BAG, "--played", played,
                   "--recorded", recorded, "--out", tmp_path / "out", "--camera-height", 1.65)


def test_evaluate_bag_no_such_bag(bag, tmp_path):
    assert_refused(1, "there is no bag", EVALUATE_BAG, "--played", tmp_path / "none.bag", "--recorded",
                   bag, "--out", tmp_path, "--camera-height", 1.65)
