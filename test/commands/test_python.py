"""The Python module."""

import csv
import itertools
import json
import math
import os
import re
import shutil
import struct
import subprocess

import cv2
import numpy as np
import pytest
from conftest import BUILD, CAMERA_HEIGHT, FRAMES, ROOT, camera_matrix, images_of, poses_of, run

PAGES = [page for page in [ROOT / "README.md", *ROOT.glob("docs/**/*.md")]
         if "```python\nimport ground_scale_vo" in page.read_text()]


def processed(gsv, folder, change=lambda image, i: image, **options):
    """The odometry after a KITTI folder, and its results. change: of image i."""
    drive = gsv.open_drive(folder)
    odometry = gsv.MetricOdometry(drive.camera, CAMERA_HEIGHT, **options)
    return odometry, [odometry.process(change(image, i), stamp) for i, (image, stamp) in enumerate(drive)]


@pytest.fixture(scope="module")
def recorded(gsv, short):
    return processed(gsv, short, record=True)


@pytest.fixture(scope="module")
def results(recorded):
    return recorded[1]


def without_resources(metrics):
    return {name: value for name, value in metrics.items() if not re.match("ms_|peak_", name)}


@pytest.mark.parametrize("is_one_folder", [False, True])
@pytest.mark.parametrize("order", [["module", "messages"], ["messages", "module"]])
def test_module_and_ros_messages_in_one_interpreter(venv, tmp_path, order, is_one_folder):
    """They are in two folders of the path in any order, or copied to one folder in any order."""
    (module,) = venv.glob("lib/*/site-packages")
    places = {"module": module, "messages": BUILD / "devel/lib/python3/dist-packages"}
    folders = [places[name] for name in order]
    if is_one_folder:
        for folder in folders:
            shutil.copytree(folder / "ground_scale_vo", tmp_path / "ground_scale_vo", dirs_exist_ok=True)
        folders = [tmp_path]
    code = """if True:
        import sys
        import ground_scale_vo
        from ground_scale_vo.msg import VoFrame
        assert "ground_scale_vo._core" not in sys.modules and not hasattr(ground_scale_vo, "none")
        from ground_scale_vo import MetricOdometry
        from ground_scale_vo.bags import open_bag"""
    run("/usr/bin/python3", "-c", code, env={**os.environ, "PYTHONPATH": os.pathsep.join(map(str, folders))})


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_documented_example_gives_the_poses_of_evaluate(gsv, short, evaluated, page):
    code = re.search(r"```python\n(import ground_scale_vo.*?)```", page.read_text(), re.DOTALL)[1]
    printed = []
    exec(code.replace("/path/to/sequence", str(short)), {"print": printed.append})
    expected = poses_of(evaluated / "poses.txt")
    metric = [i for i, pose in enumerate(printed) if pose is not None]
    assert len(printed) == len(expected) and len(metric) > 30
    assert all(np.array_equal(printed[i][:3], expected[i]) for i in metric)


def test_smoothed_results(gsv, short, recorded, tmp_path):
    """A pose from the first tracked frame on; the results before stay as they were."""
    drive, (odometry, results) = gsv.open_drive(str(short)), recorded
    before, smoothed = odometry.metrics(drive.ground_truth), odometry.smoothed()
    after = smoothed.metrics(drive.ground_truth)
    assert after["smoothed"] and not before["smoothed"]
    assert after["first_metric_pose_m"] <= before["first_metric_pose_m"]
    assert after["rle_percent"] < 1 and not np.array_equal(smoothed.poses(), odometry.poses())
    assert without_resources(odometry.metrics(drive.ground_truth)) == without_resources(before)
    smoothed.write(tmp_path, drive.ground_truth)
    assert np.array_equal(smoothed.poses()[:, :3], poses_of(tmp_path / "poses.txt"))


def test_files_and_metrics_are_the_same_as_of_evaluate(gsv, short, recorded, evaluated, tmp_path):
    drive, (odometry, results) = gsv.open_drive(str(short)), recorded
    truth = (drive.ground_truth, drive.ground_truth_heights)
    odometry.write(tmp_path, *truth)
    for name in ("poses.txt", "trajectory_tum.txt", "scale.csv"):
        assert (tmp_path / name).read_text() == (evaluated / name).read_text()
    expected = json.loads((evaluated / "metrics.json").read_text())
    assert without_resources(odometry.metrics(*truth)) == without_resources(expected)
    assert np.array_equal(odometry.poses()[:, :3], poses_of(evaluated / "poses.txt"))
    with open(evaluated / "scale.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    for result, row in zip(results, rows):
        assert (result.scale_status, result.reason) == (row["status"], row["reason"])
        if result.scale is not None:
            assert (result.scale, result.sigma) == pytest.approx((float(row["scale"]), float(row["sigma"])))
            assert result.plane[:3] == pytest.approx([float(row[name]) for name in ("nx", "ny", "nz")])


def test_result(gsv, short, results):
    first, last = results[0], results[-1]
    assert (first.status, first.scale_status, first.reason) == ("initialising", "unknown", "vo_not_tracking")
    assert first.pose is first.covariance is first.scale is first.sigma is first.plane is None
    assert (last.status, last.stamp) == ("tracking", 3900000000)
    assert last.pose.shape == (4, 4) and last.pose[2, 3] > 5
    assert last.covariance.shape == (6, 6) and (np.linalg.eigvalsh(last.covariance) > 0).all()
    assert last.scale > 0 and 0 < last.sigma < last.scale
    assert np.linalg.norm(last.plane[:3]) == pytest.approx(1) and last.plane[1] < -0.9
    assert last.plane[3] == pytest.approx(CAMERA_HEIGHT)
    assert len(last.tracks) == len(last.points) == len(np.unique(last.track_ids))
    # The points on the road satisfy the plane's equation, and all are where the tracks show them.
    assert (np.abs(last.points @ last.plane[:3] + last.plane[3]) < 0.05).sum() > 10
    camera, known = gsv.open_drive(short).camera, np.isfinite(last.points[:, 0])
    x, y, z = last.points[known].T
    pixels = np.stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy], -1)
    assert np.median(np.linalg.norm(pixels - last.tracks[known], axis=1)) < 0.5
    # The distance along z is as uncertain as the scale.
    sigma = np.sqrt(last.covariance[2, 2]) / last.pose[2, 3]
    assert 0.5 < sigma / (last.sigma / last.scale) < 2


def test_options_and_mask_are_used(gsv, shortest):
    def last(**options):
        return processed(gsv, shortest, **options)[1][-1]

    default = last()
    assert len(last(**{"tracker/cell_size": 0.04}).tracks) < 0.7 * len(default.tracks)
    assert last(refine=True).scale == default.scale != last(refine=False).scale
    mask = np.full((248, 800), 255, np.uint8)
    mask[:, :400] = 0
    assert default.tracks[:, 0].min() < 100 and last(mask=mask).tracks[:, 0].min() > 395


def test_whether_the_lens_is_estimated_counts(gsv, shortest):
    def sigma(is_estimated):
        drive = gsv.open_drive(shortest)
        odometry = gsv.MetricOdometry(drive.camera._replace(lens_is_estimated=is_estimated), CAMERA_HEIGHT)
        return [odometry.process(*image) for image in drive][-1].sigma
    assert sigma(True) != sigma(False)


def test_image_may_be_reused_and_need_not_be_contiguous(gsv, short, results):
    drive = gsv.open_drive(short)
    odometry = gsv.MetricOdometry(drive.camera, CAMERA_HEIGHT)
    buffer = np.zeros((drive.camera.height, 2 * drive.camera.width), np.uint8)
    image = buffer[:, ::2]
    for (decoded, stamp), expected in zip(drive, results[:20]):
        image[:] = decoded
        result = odometry.process(image, np.int64(stamp))
        image[:] = 0
    assert result.pose is not None and np.array_equal(result.pose, expected.pose)


def test_sequence(gsv, short):
    drive = gsv.open_drive(short)
    assert drive.name == "short" and len(drive) == FRAMES
    assert drive.ground_truth[:, :3] == pytest.approx(poses_of(short / "poses.txt"))
    assert drive.ground_truth_heights == pytest.approx(np.loadtxt(short / "ground.txt")[:, 0])
    for _ in range(2):  # it can be read again
        assert [stamp for _, stamp in drive] == pytest.approx(1e9 * np.loadtxt(short / "times.txt"))
    assert drive.camera[2:6] == pytest.approx(camera_matrix(short)[[0, 1, 0, 1], [0, 1, 2, 2]])


def test_arrays_of_more_bits_are_those_of_eight(gsv, short, results):
    """The camera uses 12 of 16 bits."""
    _, twelve = processed(gsv, short, lambda image, i: image.astype(np.uint16) * 16 + image // 16)
    assert twelve[-1].pose[:3, 3] == pytest.approx(results[-1].pose[:3, 3], abs=0.02)


def test_unusual_height_is_confirmed(gsv):
    gsv.MetricOdometry(gsv.Camera(96, 64, 60, 60, 48, 32), 30, unusual_height=True)


@pytest.mark.parametrize("angle", [0, 90, 180, 270])
def test_video_is_turned_as_ffmpeg_turns_it(gsv, shortest, tmp_path, angle):
    video = tmp_path / "video.mov"
    run("ffmpeg", "-v", "error", "-i", shortest / "image_0/%06d.png", "-frames:v", 3, "-c:v", "png", video)
    data = bytearray(video.read_bytes())
    matrix = data.index(b"tkhd") + 44  # ISO 14496-12: angle of the track header
    c, s = ((1, 0), (0, 1), (-1, 0), (0, -1))[angle // 90]
    data[matrix:matrix + 36] = struct.pack(">9i", c << 16, s << 16, 0, -s << 16, c << 16, 0, 0, 0, 1 << 30)
    video.write_bytes(data)
    height, width = images_of(shortest)[0].shape
    if angle % 180:
        width, height = height, width
    camera = tmp_path / "camera.yaml"
    camera.write_text(f"image_width: {width}\nimage_height: {height}\n"
                      f"camera_matrix: {{data: [400, 0, {width / 2}, 0, 400, {height / 2}, 0, 0, 1]}}\n"
                      "distortion_model: plumb_bob\ndistortion_coefficients: {data: [0, 0, 0, 0, 0]}\n")
    subprocess.run(["ffmpeg", "-v", "error", "-i", video, "-pix_fmt", "gray", tmp_path / "%d.png"], check=True)
    images = [image for image, _ in gsv.open_drive(video, camera=camera)]
    assert len(images) == 3
    for i, image in enumerate(images):
        expected = cv2.imread(str(tmp_path / f"{i + 1}.png"), cv2.IMREAD_GRAYSCALE)
        assert np.abs(image.astype(int) - expected).max() <= 2


def test_calibration_of_another_size(gsv):
    with pytest.raises(gsv.DataError, match="the camera is of another image size"):
        gsv.MetricOdometry(gsv.Camera(96, 64, 120, 120, 96, 64), 1.5)
    with pytest.warns(UserWarning, match="are they cropped?"):
        gsv.MetricOdometry(gsv.Camera(96, 64, 120, 120, 48, 10), 1.5)


@pytest.mark.parametrize("error, text, call", [
    (TypeError, "missing 1 required positional argument: 'camera_height'", "Odometry(camera)"),
    (ValueError, "camera_height is nan, it must lie in", "Odometry(camera, nan)"),
    (TypeError, "camera is of type tuple, it must be a Camera", "Odometry((96, 64), 1.5)"),
    (ValueError, "there is no option refin; did you mean refine?", "Odometry(camera, 1.5, refin=True)"),
    (ValueError, "mask has the shape (2, 2), it must be (64, 96)",
     "Odometry(camera, 1.5, mask=np.zeros((2, 2), np.uint8))"),
    (ValueError, "camera fx [px] is nan", "Odometry(camera._replace(fx=nan), 1.5)"),
    (TypeError, "image has the dtype float64, it must be uint8 or uint16", "process(np.zeros((64, 96)), 1)"),
    (ValueError, "image has the shape (64, 96, 3), it must be (64, 96)",
     "process(np.zeros((64, 96, 3), np.uint8), 1)"),
    (TypeError, "stamp is of type float, it must be an integer [ns]", "process(image, 0.1)"),
    (ValueError, "stamp is 5, it must be greater", "process(image, 5), process(image, 5)"),
    (ValueError, "stamp is only 33 ns after that of the previous image: is it in milliseconds",
     "process(image, 5), process(image, 38)"),
    (ValueError, "camera_height is 120, it must lie in", "Odometry(camera, 120)"),
    (ValueError, "camera_height is 30 m, on a road vehicle it is 0.2 to 5 m: is it in centimetres?", "Odometry(camera, 30)"),
    (ValueError, "record is False", "odometry.poses()"),
    (ValueError, "record is False", "odometry.smoothed()"),
    (ValueError, "ground_truth[0] is not a finite rigid transform",
     "recorded.metrics(np.array([[[1., 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [5, 0, 0, 1]]]))"),
    (ValueError, "/none: no such file or folder", "gsv.open_drive('/none')"),
])
def test_refuses(gsv, error, text, call):
    camera = gsv.Camera(96, 64, 60, 60, 48, 32)
    odometry, image = gsv.MetricOdometry(camera, 1.5), np.zeros((64, 96), np.uint8)
    names = {"gsv": gsv, "np": np, "nan": math.nan, "camera": camera, "image": image,
             "Odometry": gsv.MetricOdometry, "odometry": odometry, "process": odometry.process,
             "recorded": gsv.MetricOdometry(camera, 1.5, record=True)}
    with pytest.raises(error, match=re.escape(text)):
        eval(call, names)


def test_strange_values_do_not_crash(gsv, tmp_path, monkeypatch):
    """Every call returns, or raises TypeError or ValueError with a sentence."""
    monkeypatch.chdir(tmp_path)
    camera, image, stamps = gsv.Camera(96, 64, 60, 60, 48, 32), np.zeros((64, 96), np.uint8), itertools.count(0, 10**8)
    odometry = gsv.MetricOdometry(camera, 1.5, record=True)
    strange = [
        None, -1, 2**63, 10**400, math.inf, 1j, "", "\ud800", b"bytes", [], {}, object(), odometry, camera,
        np.array(1.0), np.zeros(0), np.zeros((0, 4, 4)), np.full((2, 4, 4), math.nan), np.array([None]),
        np.zeros((96, 64), np.uint8), np.broadcast_to(np.uint8(7), (64, 96)), np.zeros((128, 96), np.uint8)[::-2]]
    Odometry = gsv.MetricOdometry
    for value in strange:
        for call in (lambda: Odometry(value, 1.5), lambda: Odometry(camera, value),
                     lambda: Odometry(camera._replace(width=value), 1.5),
                     lambda: Odometry(camera, 1.5, mask=value), lambda: Odometry(camera, 1.5, refine=value),
                     lambda: odometry.process(value, next(stamps)), lambda: odometry.process(image, value),
                     lambda: odometry.metrics(value), lambda: odometry.metrics(None, value),
                     lambda: odometry.write(value), lambda: list(gsv.open_drive(value))):
            try:
                call()
            except (TypeError, ValueError) as error:
                assert str(error)
