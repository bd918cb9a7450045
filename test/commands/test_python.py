"""The Python module."""

import csv
import importlib
import itertools
import json
import math
import os
import re
import shutil
import types

import numpy as np
import pytest
from conftest import BUILD, CAMERA_HEIGHT, FRAMES, ROOT, camera_matrix, poses_of, run

PAGES = [page for page in [ROOT / "README.md", *ROOT.glob("docs/**/*.md")]
         if "```python\nimport ground_scale_vo" in page.read_text()]


def processed(gsv, folder, change=lambda image, i: image, **options):
    """The odometry after a KITTI folder, and its results. change: of image i."""
    drive = gsv.read_kitti(folder)
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
    """From two folders of the path in any order, or copied to one folder in any order."""
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
        from ground_scale_vo.calibration import Calibration"""
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


def test_files_and_metrics_are_the_same_as_of_evaluate(gsv, short, recorded, evaluated, tmp_path):
    drive, (odometry, results) = gsv.read_kitti(str(short)), recorded
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
    camera, known = gsv.read_kitti(short).camera, np.isfinite(last.points[:, 0])
    x, y, z = last.points[known].T
    pixels = np.stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy], -1)
    assert np.median(np.linalg.norm(pixels - last.tracks[known], axis=1)) < 0.5
    # The distance along z is as uncertain as the scale.
    sigma = np.sqrt(last.covariance[2, 2]) / last.pose[2, 3]
    assert 0.5 < sigma / (last.sigma / last.scale) < 2


def test_a_new_map_after_a_loss(gsv, short):
    def change(image, i):  # mirrored, the street is another one
        return image if i < 12 else 0 * image if i < 16 else image[:, ::-1]

    _, results = processed(gsv, short, change)
    assert [results[i].status for i in (11, 15, 39)] == ["tracking", "lost", "tracking"]
    assert results[15].pose is None and results[39].map_id == results[11].map_id + 1


def test_options_and_mask_are_used(gsv, shortest):
    def last(**options):
        return processed(gsv, shortest, **options)[1][-1]

    default = last()
    assert len(last(**{"tracker/cell_size": 0.04}).tracks) < 0.7 * len(default.tracks)
    assert last(refine=True).scale == default.scale != last(refine=False).scale
    mask = np.full((248, 800), 255, np.uint8)
    mask[:, :400] = 0
    assert default.tracks[:, 0].min() < 100 and last(mask=mask).tracks[:, 0].min() > 395


def test_image_may_be_reused_and_need_not_be_contiguous(gsv, short, results):
    drive = gsv.read_kitti(short)
    odometry = gsv.MetricOdometry(drive.camera, CAMERA_HEIGHT)
    buffer = np.zeros((drive.camera.height, 2 * drive.camera.width), np.uint8)
    image = buffer[:, ::2]
    for (decoded, stamp), expected in zip(drive, results[:20]):
        image[:] = decoded
        result = odometry.process(image, np.int64(stamp))
        image[:] = 0
    assert result.pose is not None and np.array_equal(result.pose, expected.pose)


def test_sequence(gsv, short):
    drive = gsv.read_kitti(short)
    assert drive.name == "short" and len(drive) == FRAMES
    assert drive.ground_truth[:, :3] == pytest.approx(poses_of(short / "poses.txt"))
    assert drive.ground_truth_heights == pytest.approx(np.loadtxt(short / "ground.txt")[:, 0])
    assert drive.stamps == pytest.approx(1e9 * np.loadtxt(short / "times.txt")) and drive.stamps.dtype == np.int64
    assert [stamp for _, stamp in drive] == drive.stamps.tolist()
    assert drive.camera[2:6] == pytest.approx(camera_matrix(short)[[0, 1, 0, 1], [0, 1, 2, 2]])


def test_damaged_image_ends_the_iteration(gsv, shortest, tmp_path):
    folder = shutil.copytree(shortest, tmp_path / "drive")
    for name in ("poses.txt", "ground.txt"):
        (folder / name).unlink()
    damaged = folder / "image_0/000001.png"
    damaged.write_bytes(damaged.read_bytes()[:3000])
    drive = gsv.read_kitti(folder)
    assert drive.ground_truth is drive.ground_truth_heights is None
    images = iter(drive)
    next(images)
    with pytest.raises(gsv.DataError, match="000001.png: is not a whole PNG"):
        next(images)
    assert next(images, None) is None


K = np.array([[500.0, 0, 310], [0, 510, 230], [0, 0, 1]])


def test_calibration_files(gsv, tmp_path):
    """The formats of the same camera, whose focal lengths differ."""
    module = importlib.import_module("ground_scale_vo.calibration")
    D = [-0.2, 0.05, 0.001, -0.001]

    def ros(model, D):
        return json.dumps({"image_width": 640, "image_height": 480, "distortion_model": model,
                           "camera_matrix": {"data": K.ravel().tolist()}, "distortion_coefficients": {"data": D}})

    def kalibr(model):
        return json.dumps({"cam0": {"camera_model": "pinhole", "intrinsics": [500, 510, 310, 230],
                                    "distortion_model": model, "distortion_coeffs": D, "resolution": [640, 480]}})

    file = tmp_path / "camera"
    for text, is_fisheye in (
            (ros("plumb_bob", D + [0.0]), False), (ros("rational_polynomial", D + [0.0] * 4), False),
            (ros("equidistant", D), True), (kalibr("radtan"), False), (kalibr("none"), False),
            (kalibr("equidistant"), True), (kalibr("fisheye"), True),
            ("P0: 500 0 310 0 0 510 230 0 0 0 1 0\nP1: 1 0 2 0 0 3 4 0 0 0 1 0\n", False)):
        file.write_text(text)
        calibration = module.read_calibration(file)
        assert np.array_equal(calibration.K, K) and calibration.is_fisheye is is_fisheye, text
        assert calibration.size == (None if text[0] == "P" else (640, 480))
        assert calibration.D[:4].tolist() == ([0] * 4 if text[0] == "P" else D)
        assert module.Rectification(calibration, (640, 480)).camera == gsv.Camera(640, 480, 500, 510, 310, 230)


@pytest.mark.parametrize("encoding", ["mono8", "rgb8", "bgr8", "rgba8", "bgra8", "bayer_rggb8", "bayer_bggr8",
                                      "bayer_gbrg8", "bayer_grbg8"])
def test_encodings_of_a_bag(gsv, encoding):
    """An image of one colour, with padding at the ends of the rows."""
    module = importlib.import_module("ground_scale_vo.images")
    colour, grey = {"r": 200, "g": 100, "b": 20, "a": 255}, 0.299 * 200 + 0.587 * 100 + 0.114 * 20
    pattern = [colour.get(c, grey) for c in encoding.replace("mono", "m").replace("bayer_", "")[:-1]]
    is_bayer = encoding.startswith("bayer")
    pixels = np.round(np.tile(np.reshape(pattern, (2, 2)), (4, 5)) if is_bayer else np.tile(pattern, (8, 10)))
    rows = np.hstack([pixels, np.full((8, 3), 77)]).astype(np.uint8)
    message = types.SimpleNamespace(encoding=encoding, width=10, height=8, step=rows.shape[1], data=rows.tobytes())
    image = module._grey_of(message, "/image")
    assert image.shape == (8, 10) and np.abs(image[2:-2, 2:-2] - grey).max() <= 1


@pytest.mark.parametrize("error, text, call", [
    (TypeError, "missing 1 required positional argument: 'camera_height'", "Odometry(camera)"),
    (ValueError, "camera_height is nan, it must lie in", "Odometry(camera, nan)"),
    (TypeError, "camera is of type tuple, it must be a Camera", "Odometry((96, 64), 1.5)"),
    (ValueError, "there is no option refin; did you mean refine?", "Odometry(camera, 1.5, refin=True)"),
    (ValueError, "mask has the shape (2, 2), it must be (64, 96)",
     "Odometry(camera, 1.5, mask=np.zeros((2, 2), np.uint8))"),
    (ValueError, "camera fx [px] is nan", "Odometry(camera._replace(fx=nan), 1.5)"),
    (TypeError, "image has the dtype float64, it must be uint8", "process(np.zeros((64, 96)), 1)"),
    (ValueError, "image has the shape (64, 96, 3), it must be (64, 96)",
     "process(np.zeros((64, 96, 3), np.uint8), 1)"),
    (TypeError, "stamp is of type float, it must be an integer [ns]", "process(image, 0.1)"),
    (ValueError, "stamp is 5, it must be greater", "process(image, 5), process(image, 5)"),
    (ValueError, "record is False", "odometry.poses()"),
    (ValueError, "ground_truth[0] is not a finite rigid transform",
     "recorded.metrics(np.array([[[1., 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [5, 0, 0, 1]]]))"),
    (ValueError, "/none: no such folder", "gsv.read_kitti('/none')"),
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
    """In any place: the call returns, or raises TypeError or ValueError with a sentence."""
    monkeypatch.chdir(tmp_path)
    camera, image, stamps = gsv.Camera(96, 64, 60, 60, 48, 32), np.zeros((64, 96), np.uint8), itertools.count()
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
                     lambda: odometry.write(value), lambda: list(gsv.read_kitti(value))):
            try:
                call()
            except (TypeError, ValueError) as error:
                assert str(error)
