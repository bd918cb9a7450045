"""The Python module."""

import ast
import csv
import faulthandler
import importlib
import json
import math
import re
import sys
import threading
import types

import numpy as np
import pytest
from conftest import CAMERA_HEIGHT, ROOT, TIMEOUT_S, WITHOUT_MESSAGES, run


@pytest.fixture(scope="module")
def results(gsv, short):
    drive = gsv.read_kitti(short)
    odometry = gsv.MetricOdometry(drive.camera, CAMERA_HEIGHT)
    return [odometry.process(image, stamp) for image, stamp in drive]


def read_poses(file):
    return np.loadtxt(file).reshape(-1, 3, 4)


def without_resources(metrics):
    return {name: value for name, value in metrics.items() if not re.match("ms_|peak_", name)}


@pytest.mark.parametrize("page", ["README.md", "docs/how-to/python.md"])
def test_documented_example_gives_the_poses_of_run_sequence(gsv, short, evaluated, page):
    code = re.search(r"```python\n(import ground_scale_vo.*?)```", (ROOT / page).read_text(), re.DOTALL)[1]
    printed = []
    exec(code.replace("/path/to/sequence", str(short)), {"print": printed.append})
    expected = read_poses(evaluated / "poses.txt")
    assert len(printed) == len(expected)
    metric = [i for i, pose in enumerate(printed) if pose is not None]
    assert len(metric) > 30
    assert all(np.array_equal(printed[i][:3], expected[i]) for i in metric)


def test_files_and_metrics_are_those_of_run_sequence(gsv, short, evaluated, tmp_path):
    drive = gsv.read_kitti(str(short))
    odometry = gsv.MetricOdometry(drive.camera, CAMERA_HEIGHT, record=True)
    for image, stamp in drive:
        odometry.process(image, stamp)
    odometry.write(tmp_path, drive.ground_truth, drive.ground_truth_heights)
    for name in ("poses.txt", "trajectory_tum.txt", "scale.csv"):
        assert (tmp_path / name).read_text() == (evaluated / name).read_text()
    metrics = odometry.metrics(drive.ground_truth, drive.ground_truth_heights)
    assert without_resources(metrics) == without_resources(
        json.loads((evaluated / "metrics.json").read_text()))
    assert np.array_equal(odometry.poses()[:, :3], read_poses(evaluated / "poses.txt"))


def test_result(results):
    first, last = results[0], results[-1]
    assert (first.status, first.scale_status, first.reason) == ("initialising", "unknown", "vo_not_tracking")
    assert first.pose is first.covariance is first.scale is first.sigma is first.plane is None
    assert np.isnan(first.points).all()
    assert (last.status, last.stamp) == ("tracking", 3900000000)
    assert last.pose.shape == (4, 4) and last.pose[2, 3] > 5
    assert last.covariance.shape == (6, 6) and (np.linalg.eigvalsh(last.covariance) > 0).all()
    assert last.scale > 0 and 0 < last.sigma < last.scale
    assert np.linalg.norm(last.plane[:3]) == pytest.approx(1) and last.plane[1] < -0.9
    assert last.plane[3] == pytest.approx(CAMERA_HEIGHT)
    tracks = len(last.tracks)
    assert last.tracks.shape == (tracks, 2) and last.points.shape == (tracks, 3)
    assert last.track_ids.shape == (tracks,) and (np.diff(last.track_ids.astype(int)) > 0).all()
    # The points on the road satisfy the plane's equation.
    distance = last.points @ last.plane[:3] + last.plane[3]
    assert (np.abs(distance) < 0.05).sum() > 10


def test_result_without_a_scale(gsv, shortest):
    drive = gsv.read_kitti(shortest)
    odometry = gsv.MetricOdometry(drive.camera, CAMERA_HEIGHT, refine=False, **{"gpe/min_points": 1000000})
    last = [odometry.process(image, stamp) for image, stamp in drive][-1]
    assert (last.status, last.scale_status, last.pose, last.scale) == ("initialising", "unknown", None, None)
    assert len(last.tracks) > 100 and np.isnan(last.points).all()


def test_results_are_those_of_run_sequence(gsv, short, results, evaluated):
    with open(evaluated / "scale.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    for result, row in zip(results, rows):
        assert (result.scale_status, result.reason) == (row["status"], row["reason"])
        if result.scale is None:
            continue
        assert (result.scale, result.sigma) == pytest.approx((float(row["scale"]), float(row["sigma"])))
        assert result.plane[:3] == pytest.approx([float(row[name]) for name in ("nx", "ny", "nz")])
    # The distance is as uncertain as the scale, and the points are where the tracks show them.
    last = results[-1]
    ahead = last.pose[:3, 3] / np.linalg.norm(last.pose[:3, 3])
    sigma = np.sqrt(ahead @ last.covariance[:3, :3] @ ahead) / np.linalg.norm(last.pose[:3, 3])
    assert 0.5 < sigma / (last.sigma / last.scale) < 2
    camera, known = gsv.read_kitti(short).camera, np.isfinite(last.points[:, 0])
    x, y, z = last.points[known].T
    pixels = np.stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy], -1)
    assert np.median(np.linalg.norm(pixels - last.tracks[known], axis=1)) < 0.5


def test_a_new_map_after_a_loss(gsv, short):
    drive = gsv.read_kitti(short)
    odometry = gsv.MetricOdometry(drive.camera, CAMERA_HEIGHT)
    # Mirrored, the street is another one.
    results = [odometry.process(image if i < 12 else 0 * image if i < 16 else image[:, ::-1], stamp)
               for i, (image, stamp) in enumerate(drive)]
    assert [results[i].status for i in (11, 15, 39)] == ["tracking", "lost", "tracking"]
    assert results[15].pose is None and results[39].map_id == results[11].map_id + 1


def test_options_and_mask_are_used(gsv, shortest):
    drive = gsv.read_kitti(shortest)
    images = list(drive)

    def last(**options):
        odometry = gsv.MetricOdometry(drive.camera, CAMERA_HEIGHT, **options)
        return [odometry.process(image, stamp) for image, stamp in images][-1]

    default = last()
    assert len(last(**{"tracker/cell_size": 0.04}).tracks) < 0.7 * len(default.tracks)
    assert len(last(**{"tracker/cell_size": 0.0405}).tracks) != len(last(**{"tracker/cell_size": 0.0495}).tracks)
    assert last(refine=True).scale == default.scale != last(refine=False).scale
    mask = np.full((drive.camera.height, drive.camera.width), 255, np.uint8)
    mask[:, :400] = 0
    assert default.tracks[:, 0].min() < 100 and last(mask=mask).tracks[:, 0].min() > 395


def test_sequence(gsv, short):
    drive = gsv.read_kitti(short)
    assert drive.ground_truth[:, :3] == pytest.approx(read_poses(short / "poses.txt"))
    assert drive.ground_truth_heights == pytest.approx(np.loadtxt(short / "ground.txt")[:, 0])
    assert drive.stamps == pytest.approx(1e9 * np.loadtxt(short / "times.txt")) and drive.stamps.dtype == np.int64
    assert [stamp for _, stamp in drive] == drive.stamps.tolist()
    P = np.array((short / "calib.txt").read_text().split()[1:], float)
    assert drive.camera[2:] == pytest.approx((P[0], P[5], P[2], P[6]))


def test_calibration_files(gsv, tmp_path):
    """The formats of the same camera, whose focal lengths differ."""
    module = importlib.import_module("ground_scale_vo.calibration")
    K = [[500.0, 0, 310], [0, 510, 230], [0, 0, 1]]
    D = [-0.2, 0.05, 0.001, -0.001]
    texts = {
        "ros.yaml": json.dumps({"image_width": 640, "image_height": 480, "distortion_model": "plumb_bob",
                                "camera_matrix": {"data": sum(K, [])},
                                "distortion_coefficients": {"data": D + [0.0]}}),
        "rational.yaml": json.dumps({"image_width": 640, "image_height": 480, "camera_matrix": {"data": sum(K, [])},
                                     "distortion_model": "rational_polynomial",
                                     "distortion_coefficients": {"data": D + [0.0] * 4}}),
        "kalibr.yaml": json.dumps({"cam0": {"camera_model": "pinhole", "intrinsics": [500, 510, 310, 230],
                                            "distortion_model": "radtan", "distortion_coeffs": D,
                                            "resolution": [640, 480]}}),
        "calib.txt": "P0: 500 0 310 0 0 510 230 0 0 0 1 0\nP1: 1 0 2 0 0 3 4 0 0 0 1 0\n",
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
        calibration = module.read_calibration(tmp_path / name)
        assert calibration.K.tolist() == K and not calibration.is_fisheye, name
        assert calibration.size == (None if name == "calib.txt" else (640, 480))
        assert calibration.D[:4].tolist() == ([0] * 4 if name == "calib.txt" else D)
        assert module.Rectification(calibration, (640, 480)).camera == gsv.Camera(640, 480, 500, 510, 310, 230)


@pytest.mark.parametrize("model, is_fisheye", [
    ("plumb_bob", False), ("rational_polynomial", False), ("radtan", False), ("none", False),
    ("equidistant", True), ("fisheye", True)])
def test_distortion_models(gsv, tmp_path, model, is_fisheye):
    """Four coefficients are valid for both kinds of models."""
    file = tmp_path / "camera.yaml"
    file.write_text(json.dumps({"image_width": 640, "image_height": 480, "distortion_model": model,
                                "camera_matrix": {"data": [500, 0, 310, 0, 510, 230, 0, 0, 1]},
                                "distortion_coefficients": {"data": [-0.05, 0.01, 0, 0]}}))
    module = importlib.import_module("ground_scale_vo.calibration")
    assert module.read_calibration(file).is_fisheye is is_fisheye


def test_fisheye_without_coefficients_is_rectified(gsv):
    """The radius in its images is proportional to the angle, not to its tangent."""
    module = importlib.import_module("ground_scale_vo.calibration")
    K = np.array([[100.0, 0, 100], [0, 100, 50], [0, 0, 1]])
    grey = np.tile(np.arange(201, dtype=np.uint8), (101, 1))  # the value is the column
    rectified = module.Rectification(module.Calibration((201, 101), K, True, np.zeros(4)), (201, 101)).image(grey)
    assert abs(int(rectified[50, 180]) - (100 + 100 * np.arctan(0.8))) <= 1
    plain = module.Rectification(module.Calibration((201, 101), K, False, np.zeros(4)), (201, 101)).image(grey)
    assert (plain == grey).all()


def test_rectified_mask(gsv):
    """Grey values above 0 are visible; a pixel that depends on a masked one is masked."""
    module = importlib.import_module("ground_scale_vo.calibration")
    K = np.array([[500.0, 0, 310], [0, 510, 230], [0, 0, 1]])
    rectification = module.Rectification(module.Calibration((640, 480), K, False, np.array([0.2, 0, 0, 0])),
                                         (640, 480))
    mask = np.ones((480, 640), np.uint8)
    mask[:, :320] = 0
    rectified = rectification.mask(mask)
    smooth = rectification.image(np.where(mask, 255, 0).astype(np.uint8))
    assert set(np.unique(rectified)) == {0, 255} and ((smooth > 0) & (smooth < 255)).any()
    assert np.array_equal(rectified == 255, smooth == 255)


@pytest.mark.parametrize("encoding, order", [("mono8", None), ("rgb8", "rgb"), ("bgr8", "bgr"), ("rgba8", "rgba"),
                                             ("bgra8", "bgra"), ("bayer_rggb8", "rggb"), ("bayer_bggr8", "bggr"),
                                             ("bayer_gbrg8", "gbrg"), ("bayer_grbg8", "grbg")])
def test_encodings_of_a_bag(gsv, encoding, order):
    """An image of one colour, with padding at the ends of the rows."""
    module = importlib.import_module("ground_scale_vo.images")
    colour, grey = {"r": 200, "g": 100, "b": 20, "a": 255}, 0.299 * 200 + 0.587 * 100 + 0.114 * 20
    if order is None:
        pixels = np.full((8, 10), round(grey))
    elif encoding.startswith("bayer"):
        pixels = np.tile(np.array([colour[c] for c in order]).reshape(2, 2), (4, 5))
    else:
        pixels = np.tile([colour[c] for c in order], (8, 10))
    rows = np.hstack([pixels, np.full((8, 3), 77)]).astype(np.uint8)
    message = types.SimpleNamespace(encoding=encoding, width=10, height=8, step=rows.shape[1], data=rows.tobytes())
    image = module._grey_of(message, "/image")
    assert image.shape == (8, 10) and np.abs(image[2:-2, 2:-2] - grey).max() <= 1


def test_array_may_be_reused_and_need_not_be_contiguous(gsv, short, results):
    drive = gsv.read_kitti(short)
    odometry = gsv.MetricOdometry(drive.camera, CAMERA_HEIGHT)
    buffer = np.zeros((drive.camera.height, 2 * drive.camera.width), np.uint8)
    image = buffer[:, ::2]
    for (decoded, stamp), expected in zip(drive, results):
        image[:] = decoded
        result = odometry.process(image, np.int64(stamp))
        image[:] = 0
    assert np.array_equal(result.pose, expected.pose)


def test_mask_may_be_reused(gsv, shortest):
    """It is in use in every image."""
    drive = gsv.read_kitti(shortest)

    def last(is_reused):
        mask = np.full((drive.camera.height, drive.camera.width), 255, np.uint8)
        mask[:, :drive.camera.width // 2] = 0
        odometry = gsv.MetricOdometry(drive.camera, CAMERA_HEIGHT, mask=mask)
        if is_reused:
            mask[:] = 255
        return [odometry.process(image, stamp) for image, stamp in drive][-1]

    kept, reused = last(False), last(True)
    assert kept.scale == reused.scale and np.array_equal(kept.tracks, reused.tracks)


@pytest.fixture
def ends_when_blocked():
    """Ends this process when the test blocks it: a thread that waits with the GIL blocks all others."""
    faulthandler.dump_traceback_later(TIMEOUT_S, exit=True)
    yield
    faulthandler.cancel_dump_traceback_later()


@pytest.mark.usefixtures("ends_when_blocked")
def test_calls_of_two_threads_are_processed_one_after_the_other(gsv):
    """Of two images with the same stamp, the second is refused."""
    odometry = gsv.MetricOdometry(gsv.Camera(1000, 1000, 500, 500, 500, 500), 1.5, record=True)
    image, rounds = np.zeros((1000, 1000), np.uint8), 20
    together, refused = threading.Barrier(2), []

    def process():
        for stamp in range(rounds):
            together.wait()
            try:
                odometry.process(image, stamp)
            except ValueError:
                refused.append(stamp)

    threads = [threading.Thread(target=process) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(refused) == list(range(rounds)) and len(odometry.poses()) == rounds


@pytest.mark.usefixtures("ends_when_blocked")
def test_other_threads_run_during_processing(gsv):
    odometry = gsv.MetricOdometry(gsv.Camera(1000, 1000, 500, 500, 500, 500), 1.5)
    # Blank: numpy would release the GIL, too, when it copies a pose.
    image, done = np.zeros((1000, 1000), np.uint8), []
    odometry.process(image, 0)
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1000)  # [s] a thread runs until it releases the GIL
    try:
        worker = threading.Thread(
            target=lambda: [done.append(odometry.process(image, i)) for i in range(1, 101)])
        worker.start()
        assert len(done) < 100
        worker.join()
    finally:
        sys.setswitchinterval(interval)


@pytest.mark.parametrize("error, text, call", [
    (TypeError, "missing 1 required positional argument: 'camera_height'", "Odometry(camera)"),
    (ValueError, "camera_height is nan, it must lie in", "Odometry(camera, nan)"),
    (ValueError, "camera_height is 0, it must lie in", "Odometry(camera, 0)"),
    (TypeError, "camera_height is of type str, it must be a number", "Odometry(camera, '1')"),
    (TypeError, "camera is of type tuple, it must be a Camera", "Odometry((96, 64), 1.5)"),
    (ValueError, "there is no option refin; did you mean refine?", "Odometry(camera, 1.5, refin=True)"),
    (ValueError, "there is no option tracker/cell; did you mean tracker/cell_size?",
     "Odometry(camera, 1.5, **{'tracker/cell': 1})"),
    (ValueError, "refine is '1.0', it must be true or false", "Odometry(camera, 1.5, refine=1)"),
    (TypeError, "max_speed is of type list", "Odometry(camera, 1.5, max_speed=[1])"),
    (ValueError, "max_speed: 'nan' is not a number", "Odometry(camera, 1.5, max_speed=nan)"),
    (ValueError, "mask has the shape (2, 2), it must be (64, 96)",
     "Odometry(camera, 1.5, mask=np.zeros((2, 2), np.uint8))"),
    (ValueError, "camera fx [px] is nan", "Odometry(camera._replace(fx=nan), 1.5)"),
    (TypeError, "camera.width is of type float, it must be an integer",
     "Odometry(camera._replace(width=96.0), 1.5)"),
    (ValueError, "camera.height is out of range", "Odometry(camera._replace(height=-1), 1.5)"),
    (TypeError, "image is of type list, it must be a numpy array", "process([[0]], 1)"),
    (TypeError, "image has the dtype float64, it must be uint8", "process(np.zeros((64, 96)), 1)"),
    (ValueError, "image has the shape (64, 96, 3), it must be (64, 96)",
     "process(np.zeros((64, 96, 3), np.uint8), 1)"),
    (TypeError, "stamp is of type float, it must be an integer [ns]", "process(image, 0.1)"),
    (ValueError, "stamp is out of range", "process(image, -1)"),
    (ValueError, "stamp is 5, it must be greater than that of the previous image, 5",
     "process(image, 5), process(image, 5)"),
    (ValueError, "record is False", "odometry.poses()"),
    (ValueError, "ground_truth has the shape (4, 4), it must be (N, 4, 4)", "recorded.metrics(np.eye(4))"),
    (ValueError, "ground_truth[0] is not a finite rigid transform",
     "recorded.metrics(np.full((1, 4, 4), nan))"),
    (ValueError, "ground_truth_heights[0] is nan", "recorded.metrics(None, np.array([nan]))"),
    (TypeError, "ground_truth has the dtype complex128", "recorded.metrics(1j * np.zeros((1, 4, 4)))"),
    (TypeError, "folder is of type int", "gsv.read_kitti(3)"),
    (TypeError, "folder is of type NoneType", "recorded.write(None)"),
    (ValueError, "/none: no such folder", "gsv.read_kitti('/none')"),
    (ValueError, "folder is 'a\\x00b', it must be UTF-8", "recorded.write('a\\0b')"),
    (ValueError, "folder is '\\ud800', it must be UTF-8", "gsv.read_kitti('\\ud800')"),
    (ValueError, "ground_truth has 3 entries, but 0 images are recorded",
     "recorded.metrics(np.repeat(np.eye(4)[None], 3, 0))"),
    (ValueError, "ground_truth[0] is not a finite rigid transform",
     "recorded.metrics(np.array([[[1., 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [5, 0, 0, 1]]]))"),
    (ValueError, "ground_truth_heights has the shape (1, 1), it must be (N,)",
     "recorded.metrics(None, np.ones((1, 1)))"),
    (ValueError, "ground_truth_heights has 7 entries", "recorded.metrics(None, np.ones(7))"),
])
def test_refuses(gsv, error, text, call):
    camera = gsv.Camera(96, 64, 60, 60, 48, 32)
    odometry, image = gsv.MetricOdometry(camera, 1.5), np.zeros((64, 96), np.uint8)
    names = {"gsv": gsv, "np": np, "nan": math.nan, "camera": camera, "image": image,
             "Odometry": gsv.MetricOdometry, "odometry": odometry, "process": odometry.process,
             "recorded": gsv.MetricOdometry(camera, 1.5, record=True)}
    with pytest.raises(error, match=re.escape(text)):
        eval(call, names)


def test_damaged_image_ends_the_iteration(gsv, short, tmp_path):
    (tmp_path / "image_0").mkdir()
    for name in ("calib.txt", "times.txt"):
        (tmp_path / name).write_text((short / name).read_text())
    for i in range(3):
        contents = (short / f"image_0/{i:06}.png").read_bytes()
        (tmp_path / f"image_0/{i:06}.png").write_bytes(contents[:3000] if i == 1 else contents)
    drive = gsv.read_kitti(tmp_path)
    assert drive.ground_truth is drive.ground_truth_heights is None
    images = iter(drive)
    next(images)
    with pytest.raises(gsv.DataError, match="000001.png: is not a whole PNG"):
        next(images)
    assert next(images, None) is None


def test_random_calls(venv, tmp_path):
    done = run(venv / "bin/python", ROOT / "test/commands/random_python_calls.py", 4000,
               env=WITHOUT_MESSAGES, cwd=tmp_path).stdout
    counts = [int(word) for word in re.findall(r"\d+", done)]
    assert sum(counts) == 4000 and min(counts) > 500, done


def test_stubs_list_the_contents_of_the_extension(gsv):
    stubs = ast.parse((ROOT / "python/ground_scale_vo/_core.pyi").read_text()).body
    module = importlib.import_module("ground_scale_vo._core")
    for node in stubs:
        if isinstance(node, ast.ClassDef) and node.name != "DataError":
            members = {member.name for member in node.body}
            assert members == {name for name in vars(getattr(module, node.name))
                               if not name.startswith("__") or name in ("__init__", "__iter__")}
    assert set(re.findall(r"^    (\w+): ", gsv.Result.__doc__, re.MULTILINE)) == set(gsv.Result._fields)
