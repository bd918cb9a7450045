"""The command `ground_scale_vo run` of the Python package."""

import importlib
import json
import shutil
import sys

import bags
import cv2
import numpy as np
import pytest
import rosbag
from conftest import CAMERA_HEIGHT, WITHOUT_MESSAGES, assert_refused, on_terminal, run
from sensor_msgs.msg import RegionOfInterest

FRAMES = 40


@pytest.fixture
def command(venv, tmp_path):
    """The words of the command that writes into tmp_path."""
    return [venv / "bin/ground_scale_vo", "run", "--out", tmp_path / "out", "--camera-height", CAMERA_HEIGHT]


@pytest.fixture(scope="module")
def video(short, tmp_path_factory):
    file = tmp_path_factory.mktemp("video") / "drive.mp4"
    writer = None
    for image in images_of(short):
        writer = writer or cv2.VideoWriter(str(file), cv2.VideoWriter_fourcc(*"mp4v"), 10, image.shape[::-1])
        writer.write(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
    writer.release()
    return file


def images_of(folder):
    return [cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) for file in sorted((folder / "image_0").iterdir())]


def camera_matrix(folder):
    projection = np.array((folder / "calib.txt").read_text().split("\n")[0].split()[1:], float)
    return projection.reshape(3, 4)[:, :3]


def distance(results):
    """Between the first and last pose [m]."""
    return np.linalg.norm(np.loadtxt(results / "trajectory_tum.txt")[-1, 1:4])


def test_kitti_folder_as_run_sequence(command, short, evaluated, tmp_path):
    done = run(*command, short, env=WITHOUT_MESSAGES)
    assert f"short: {FRAMES} frames, {FRAMES} tracked" in done.stdout and done.stderr == ""
    results = tmp_path / "out/short"
    for name in ("poses.txt", "trajectory_tum.txt", "scale.csv"):
        assert (results / name).read_text() == (evaluated / name).read_text()
    for plot in ("trajectory", "scale", "timing", "errors"):
        assert (results / f"{plot}.png").stat().st_size > 0
    metrics = json.loads((results / "metrics.json").read_text())
    assert metrics["rle_percent"] is not None and metrics["height_bias_percent"] is not None


def test_kitti_raw_drive(gsv, shortest, tmp_path):
    folder = tmp_path / "date/drive"
    shutil.copytree(shortest / "image_0", folder / "image_00/data")
    (folder / "image_00/timestamps.txt").write_text("".join(f"2011-09-26 13:02:{i:02}.0\n" for i in range(12)))
    (folder / "../calib_cam_to_cam.txt").write_text((shortest / "calib.txt").read_text().replace("P0:", "P_rect_00:"))
    module = importlib.import_module("ground_scale_vo.command_line")
    drive, calibration, _ = module.open_drive(module.parse(["run", str(folder), "--camera-height", "1"]))
    assert drive.count == 12 and np.array_equal(next(drive.images)[0], images_of(shortest)[0])
    assert np.array_equal(calibration.K, camera_matrix(shortest))


def test_bag_as_run_sequence(command, bag, short, evaluated, tmp_path):
    run(*command, bag, "--camera", short / "calib.txt", env=WITHOUT_MESSAGES)
    assert (tmp_path / "out/short/poses.txt").read_text() == (evaluated / "poses.txt").read_text()


@pytest.mark.parametrize("is_rectified", [False, True])
def test_calibration_of_a_bag(gsv, bag, short, tmp_path, capsys, is_rectified):
    def distorted(topic, message):
        if topic == bags.INFO:
            message.D, message.K = [-0.2, 0.05, 0.001, -0.001, 0], [510, 0, 300, 0, 520, 90, 0, 0, 1]
        return topic, message

    file = tmp_path / "distorted.bag"
    bags.copy(bag, file, distorted)
    module = importlib.import_module("ground_scale_vo.command_line")
    arguments = module.parse(["run", str(file), "--camera-height", "1", *["--rectified"] * is_rectified])
    drive, calibration, _ = module.open_drive(arguments)
    height, width = next(drive.images)[0].shape
    assert calibration.size == (width, height) and not calibration.is_fisheye
    if is_rectified:
        assert np.array_equal(calibration.K, camera_matrix(short)) and not calibration.D.any()
    else:
        assert calibration.K.ravel().tolist() == [510, 0, 300, 0, 520, 90, 0, 0, 1]
        assert calibration.D.tolist() == [-0.2, 0.05, 0.001, -0.001, 0]
    assert ("add --rectified" in capsys.readouterr().err) is not is_rectified
    for topic, is_hinted in (("/camera/image_rect/compressed", not is_rectified),
                             ("/robot/rectangle/image_raw", False)):  # of the topic, only its last part counts
        module.calibration_in_bag(drive._replace(topic=topic), arguments)
        assert ("add --rectified" in capsys.readouterr().err) is is_hinted


def test_bag_with_its_calibration_as_run_sequence(command, bag, evaluated, tmp_path):
    run(*command, bag, "--rectified", env=WITHOUT_MESSAGES)
    assert (tmp_path / "out/short/poses.txt").read_text() == (evaluated / "poses.txt").read_text()


@pytest.mark.parametrize("change, text", [
    ({"K": [0] * 9}, ""), ({"K": [0] * 9, "P": [0] * 12}, "is not calibrated, P is zero"),
    ({"binning_x": 2}, "binning and regions of interest are not supported, pass --camera"),
    ({"binning_y": 2}, "binning and regions"), ({"roi": RegionOfInterest(width=9)}, "binning and regions"),
    ({"roi": RegionOfInterest(height=9)}, "binning and regions"), ({"D": 5 * [np.nan]}, "has numbers that are not"),
    ({"distortion_model": "omni"}, "the distortion model is omni"), ({"D": [0.1]}, "has 1 distortion coefficients"),
    ({"distortion_model": "", "D": []}, ""), ({"binning_x": 1, "binning_y": 1}, "")])
def test_calibration_of_camera_info(gsv, bag, short, change, text):
    calibration_of = importlib.import_module("ground_scale_vo.calibration").calibration_of
    with rosbag.Bag(str(bag)) as messages:
        _, info, _ = next(messages.read_messages([bags.INFO]))
    for name, value in {"K": camera_matrix(short).ravel().tolist(), **change}.items():
        setattr(info, name, value)
    if text:
        with pytest.raises(gsv.DataError, match=f"^{bags.INFO}: {text}"):
            calibration_of(info, bags.INFO, False)
    else:
        assert np.allclose(calibration_of(info, bags.INFO, False).K, camera_matrix(short))


def test_options_reach_the_odometry(command, shortest, evaluated, tmp_path):
    mask, height = tmp_path / "mask.png", 2 * CAMERA_HEIGHT
    image = images_of(shortest)[0]
    image[:] = 0
    cv2.imwrite(str(mask), image)
    done = run(*command, shortest, "--mask", mask, "--camera-height", height, env=WITHOUT_MESSAGES)
    assert "12 frames, 0 tracked" in done.stdout
    assert json.loads((tmp_path / "out/shortest/metrics.json").read_text())["camera_height_m"] == height


@pytest.mark.parametrize("text, name, value", [("refine=false", "refine", False), ("refine=true", "refine", True),
                                               ("tracker/cell_size=0.02", "tracker/cell_size", 0.02)])
def test_values_of_options(gsv, text, name, value):
    module = importlib.import_module("ground_scale_vo.command_line")
    assert module.parse(["run", "x", "--camera-height", "1", "--set", text]).set == [(name, value)]


def test_images_whose_stamps_go_back_are_skipped(command, shortest, tmp_path):
    folder = tmp_path / "drive.1"
    folder.mkdir()
    (folder / "times.txt").write_text("0\n0.1\n0.1\n0.07\n0.08\n0.2\n")
    for i, image in enumerate(images_of(shortest)[:6]):
        cv2.imwrite(str(folder / f"{5 - i}.PNG"), image)  # the order is that of the names
    done = run(*command, folder, "--camera", shortest / "calib.txt", env=WITHOUT_MESSAGES)
    assert "3 images are skipped" in done.stderr and "drive.1: 3 frames" in done.stdout
    stamps = np.loadtxt(tmp_path / "out/drive.1/trajectory_tum.txt")[:, 0]
    assert stamps == pytest.approx([0, 0.1, 0.2])


def test_stamps_of_a_folder_are_exact(gsv, shortest, tmp_path):
    """Seconds since 1970, to the nanosecond."""
    cv2.imwrite(str(tmp_path / "0.png"), images_of(shortest)[0])
    open_images = importlib.import_module("ground_scale_vo.images").open_images
    for text, stamp in (("1317042145.964389445", 1317042145964389445), ("1.3170421459643894e9", 1317042145964389400)):
        (tmp_path / "times.txt").write_text(text)
        assert [stamp for _, stamp in open_images(tmp_path, None).images] == [stamp]
    for text in ("nan", "inf", "1e999999999", "1,5"):
        (tmp_path / "times.txt").write_text(text)
        with pytest.raises(gsv.DataError, match=f"times.txt: cannot be read .{text} is not a time"):
            open_images(tmp_path, None)


@pytest.mark.parametrize("images, stamps", [(2, 1), (0, 1)])
def test_folder_without_a_stamp_for_each_image(gsv, tmp_path, images, stamps):
    for i in range(images):
        cv2.imwrite(str(tmp_path / f"{i}.png"), np.zeros((8, 8), np.uint8))
    (tmp_path / "times.txt").write_text("0\n" * stamps)
    with pytest.raises(gsv.DataError, match=f"has {images} images and {stamps} stamps in times.txt"):
        importlib.import_module("ground_scale_vo.images").open_images(tmp_path, None)


def test_image_is_not_turned_by_its_orientation(gsv, tmp_path):
    """The calibration is that of the sensor."""
    jpeg = cv2.imencode(".jpg", np.zeros((16, 32), np.uint8))[1].tobytes()
    exif = b"\xff\xe1\0\x22Exif\0\0MM\0\x2a\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0"
    file = tmp_path / "turned.jpg"
    file.write_bytes(jpeg[:2] + exif + jpeg[2:])
    assert cv2.imread(str(file)).shape[:2] == (32, 16)
    assert importlib.import_module("ground_scale_vo.images").read_grey(file).shape == (16, 32)


def test_images_of_a_compressed_bag(gsv, bag, short, tmp_path):
    compressed = tmp_path / "compressed.bag"
    bags.compress(bag, compressed)
    drive = importlib.import_module("ground_scale_vo.images").open_images(compressed, None)
    image, stamp = next(drive.images)
    assert (drive.count, stamp) == (FRAMES, 1000000000)
    assert drive.info_topic == bags.COMPRESSED.replace("image_raw/compressed", "camera_info")
    assert cv2.absdiff(image, images_of(short)[0]).mean() < 3


def test_image_topic_of_a_bag_with_two(gsv, bag, short, tmp_path):
    def black_instead_of_info(topic, message):
        if topic != bags.INFO:
            return topic, message
        width, height = message.width, message.height
        return "/other", bags.Image(message.header, height, width, "mono8", 0, width, bytes(width * height))

    two = tmp_path / "two.bag"
    bags.copy(bag, two, black_instead_of_info)
    module = importlib.import_module("ground_scale_vo.command_line")
    arguments = ["run", str(two), "--camera", str(short / "calib.txt"), "--camera-height", "1"]
    with pytest.raises(gsv.DataError, match=f"--image must be one of its image topics: {bags.IMAGE}, /other"):
        module.open_drive(module.parse(arguments))
    for topic, first in ((bags.IMAGE, images_of(short)[0]), ("/other", 0 * images_of(short)[0])):
        drive, _, _ = module.open_drive(module.parse([*arguments, "--image", topic]))
        assert np.array_equal(next(drive.images)[0], first), topic


def test_calibration_replaces_that_of_the_kitti_folder(command, shortest, tmp_path):
    """One for images of another size is refused."""
    (tmp_path / "camera.yaml").write_text(json.dumps({"cam0": {
        "camera_model": "pinhole", "intrinsics": [500, 500, 400, 120], "distortion_model": "none",
        "distortion_coeffs": [], "resolution": [10, 20]}}))
    assert_refused(1, "the calibration is of 10x20", *command, shortest, "--camera", tmp_path / "camera.yaml",
                   env=WITHOUT_MESSAGES)


def test_bag_without_calibration_is_refused(command, bag, tmp_path):
    images = tmp_path / "images.bag"
    bags.copy(bag, images, lambda topic, message: None if topic == bags.INFO else (topic, message))
    assert_refused(2, f"--camera is missing; {images} has no {bags.INFO}", *command, images, env=WITHOUT_MESSAGES)


def test_damaged_bag_is_refused(command, damaged_bag, short):
    assert_refused(1, f"{damaged_bag}: ", *command, damaged_bag, "--camera", short / "calib.txt",
                   env=WITHOUT_MESSAGES)


def test_bag_that_is_damaged_in_the_middle_is_refused(command, bag, short, tmp_path):
    contents = bag.read_bytes()
    middle, header = len(contents) // 2, b"\x04\0\0\0op=\x02"  # a field of each message's header
    damaged = tmp_path / "damaged.bag"
    damaged.write_bytes(contents[:middle] + contents[middle:].replace(header, bytes(len(header)), 10))
    assert_refused(1, f"{damaged}: cannot be read to its end", *command, damaged, "--camera",
                   short / "calib.txt", env=WITHOUT_MESSAGES)


def test_images_of_two_sizes_are_refused(command, short, tmp_path):
    folder, K = tmp_path / "raw", camera_matrix(short)
    folder.mkdir()
    (folder / "times.txt").write_text("0\n0.1\n")
    image = images_of(short)[0]
    cv2.imwrite(str(folder / "0.png"), image)
    cv2.imwrite(str(folder / "1.png"), image[:-1])
    (tmp_path / "camera.yaml").write_text(json.dumps({"cam0": {
        "camera_model": "pinhole", "intrinsics": [K[0, 0], K[1, 1], K[0, 2], K[1, 2]],
        "distortion_model": "radtan", "distortion_coeffs": [-0.2, 0.05, 0, 0],
        "resolution": image.shape[::-1]}}))
    assert_refused(1, "an image is ", *command, folder, "--camera", tmp_path / "camera.yaml",
                   env=WITHOUT_MESSAGES)


def test_video(command, video, short, evaluated, tmp_path):
    run(*command, video, "--camera", short / "calib.txt", env=WITHOUT_MESSAGES)
    trajectory = np.loadtxt(tmp_path / "out/drive/trajectory_tum.txt")
    assert np.allclose(trajectory[:, 0], 0.1 * np.arange(FRAMES))
    assert np.allclose(np.linalg.norm(trajectory[:, 4:], axis=1), 1)
    assert distance(tmp_path / "out/drive") == pytest.approx(distance(evaluated), rel=0.03)


def test_images_at_the_end_of_a_video_have_a_stamp(gsv, video, monkeypatch):
    """OpenCV 4.6 reports 0 for those that the decoder of some videos holds: here for the last two."""
    class Capture:
        def __init__(self, *arguments):
            self.capture, self.count = VideoCapture(*arguments), 0

        def isOpened(self):
            return self.capture.isOpened()

        def read(self):
            self.count += 1
            return self.capture.read()

        def get(self, name):
            return 0 if name == cv2.CAP_PROP_POS_MSEC and self.count > FRAMES - 2 else self.capture.get(name)

    VideoCapture = cv2.VideoCapture
    module = importlib.import_module("ground_scale_vo.images")
    monkeypatch.setattr(module.cv2, "VideoCapture", Capture)
    stamps = [stamp for _, stamp in module.open_images(video, None).images]
    assert np.allclose(stamps, 1e8 * np.arange(FRAMES))


@pytest.mark.parametrize("model", ["plumb_bob", "equidistant"])
def test_distorted_images(command, short, evaluated, tmp_path, model):
    folder, K = tmp_path / "raw", camera_matrix(short)
    folder.mkdir()
    (folder / "times.txt").write_text((short / "times.txt").read_text())
    images = images_of(short)
    height, width = images[0].shape
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).astype(np.float64)
    if model == "plumb_bob":
        D = [-0.2, 0.05, 0.001, -0.001]
        source = cv2.undistortPoints(pixels.reshape(-1, 1, 2), K, np.array(D), None, None, K)
        (tmp_path / "camera.yaml").write_text(json.dumps({
            "image_width": width, "image_height": height, "camera_matrix": {"data": K.ravel().tolist()},
            "distortion_model": model, "distortion_coefficients": {"data": D}}))
    else:
        D = [-0.05, 0.01, 0.0, 0.0]
        source = cv2.fisheye.undistortPoints(pixels.reshape(-1, 1, 2), K, np.array(D), None, K)
        (tmp_path / "camera.yaml").write_text(json.dumps({"cam0": {
            "camera_model": "pinhole", "intrinsics": [K[0, 0], K[1, 1], K[0, 2], K[1, 2]],
            "distortion_model": model, "distortion_coeffs": D, "resolution": [width, height]}}))
    maps = source.reshape(height, width, 2).astype(np.float32)
    for i, image in enumerate(images):
        cv2.imwrite(str(folder / f"{i:06}.png"), cv2.remap(image, maps, None, cv2.INTER_CUBIC))
    run(*command, folder, "--camera", tmp_path / "camera.yaml", env=WITHOUT_MESSAGES)
    assert distance(tmp_path / "out/raw") == pytest.approx(distance(evaluated), rel=0.01)


def test_progress_on_a_terminal(command, short):
    assert f"{'#' * 30}] {FRAMES}/{FRAMES}" in on_terminal(*command, short, environment=WITHOUT_MESSAGES)


def test_rotated_video_is_refused_with_the_calibration_of_the_sensor(command, video, short, tmp_path):
    contents = bytearray(video.read_bytes())
    matrix = contents.index(b"tkhd") + 44  # of the display, ISO/IEC 14496-12
    contents[matrix:matrix + 36] = np.array([0, 1 << 16, 0, -1 << 16, 0, 0, 0, 0, 1 << 30], ">i4").tobytes()
    rotated = tmp_path / "rotated.mp4"
    rotated.write_bytes(contents)
    height, width = images_of(short)[0].shape
    (tmp_path / "camera.yaml").write_text(json.dumps({"cam0": {
        "camera_model": "pinhole", "intrinsics": [500, 500, 400, 120], "distortion_model": "none",
        "distortion_coeffs": [], "resolution": [width, height]}}))
    assert_refused(1, f"the images are {height}x{width}, the calibration is of {width}x{height}: calibrate",
                   *command, rotated, "--camera", tmp_path / "camera.yaml", env=WITHOUT_MESSAGES)


def test_refuses_to_overwrite_the_input(command, shortest, tmp_path):
    shutil.copytree(shortest, tmp_path / "drive")
    assert_refused(2, "would write the results to the input", *command, "drive", "--out", ".", env=WITHOUT_MESSAGES,
                   cwd=tmp_path)
    assert (tmp_path / "drive/poses.txt").read_text() == (shortest / "poses.txt").read_text()


@pytest.mark.parametrize("status, text, arguments", [
    (1, "none: no such file or folder", ["none", "--camera", "CALIB"]),
    (2, "--camera is missing", ["empty.mp4"]),
    (2, "--rectified is for the camera_info of a bag", ["empty.mp4", "--camera", "CALIB", "--rectified"]),
    (2, "--rectified is for the camera_info of a bag", ["SHORT", "--rectified"]),
    (1, "empty.mp4: is not a video", ["empty.mp4", "--camera", "CALIB"]),
    (1, "empty.bag: is not a bag", ["empty.bag", "--camera", "CALIB"]),
    (1, "none.yaml: No such file", ["empty.mp4", "--camera", "none.yaml"]),
    (1, "empty.mp4: cannot be used as a calibration (it is neither YAML",
     ["empty.mp4", "--camera", "empty.mp4"]),
    (1, "wide.yaml: cannot be used as a calibration (the camera model is omni",
     ["empty.mp4", "--camera", "wide.yaml"]),
    (1, "times.txt: cannot be read", [".", "--camera", "CALIB"]),
    (1, "in_ms/times.txt: 1.317e+12 s is not a time since 1970", ["in_ms", "--camera", "CALIB"]),
    (1, "flat.yaml: has a focal length of 0 px", ["SHORT", "--camera", "flat.yaml"]),
    (2, "camera_height is nan, it must lie in", ["SHORT", "--camera-height", "nan"]),
    (2, "there is no option refin; did you mean refine?", ["SHORT", "--set", "refin=true"]),
    (1, "none.png: No such file", ["SHORT", "--mask", "none.png"]),
    (1, "empty.mp4: cannot be decoded as an image", ["SHORT", "--mask", "empty.mp4"]),
    (1, "the mask is 8x4, the first image ", ["SHORT", "--camera", "raw.yaml", "--mask", "small.png"]),
    (1, "short.yaml: has 3 distortion coefficients, its model has 0 or 4 or 5",
     ["SHORT", "--camera", "short.yaml"]),
    (2, "there is no option mask", ["SHORT", "--set", "mask=1"]),
])
def test_refuses(gsv, command, short, tmp_path, monkeypatch, capfd, status, text, arguments):
    """In this process: the start of another takes longer than its refusal."""
    for name in ("empty.mp4", "empty.bag"):
        (tmp_path / name).touch()
    (tmp_path / "wide.yaml").write_text("cam0: {camera_model: omni}")
    height, width = images_of(short)[0].shape
    (tmp_path / "in_ms").mkdir()
    (tmp_path / "in_ms/times.txt").write_text("1317000000000\n")
    for name, f, D in (("raw", 500, [-0.2, 0.05, 0, 0]), ("short", 500, [-0.2, 0.05, 0]), ("flat", 0, [])):
        (tmp_path / f"{name}.yaml").write_text(json.dumps({"cam0": {
            "camera_model": "pinhole", "intrinsics": [f, 500, 400, 120], "distortion_model": "radtan",
            "distortion_coeffs": D, "resolution": [width, height]}}))
    cv2.imwrite(str(tmp_path / "small.png"), np.full((4, 8), 255, np.uint8))
    words = {"CALIB": short / "calib.txt", "SHORT": short}
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(words.get(word, word)) for word in (*command, *arguments)])
    assert importlib.import_module("ground_scale_vo.command_line").main() == status
    message = capfd.readouterr().err.rstrip("\n")
    assert text in message and "\n" not in message, message
