"""The command `ground_scale_vo calibrate` of the Python package, and scripts/calibrate_camera, which runs it."""

import json
import re

import cv2
import numpy as np
import pytest
import yaml
from conftest import (CAMERA_HEIGHT, SCRIPTS, assert_one_sentence, assert_refused, camera_matrix, distorted_images_of,
                      images_of, poses_of, rendered, run, tool, write_camera)

K1 = -0.05  # of the distorted images


@pytest.fixture(scope="module")
def turns(data):
    return rendered(data / "turns", "--frames", 110, "--size", "480x148", "--stop", 0)


@pytest.fixture(scope="module")
def distorted(turns, tmp_path_factory):
    """Its images with distortion, as a folder and as a video without loss."""
    folder, images = tmp_path_factory.mktemp("lens") / "turns", distorted_images_of(turns, [K1, 0, 0, 0])
    folder.mkdir()
    video = folder.with_suffix(".avi")
    writer = cv2.VideoWriter(str(video), cv2.VideoWriter_fourcc(*"FFV1"), 10, images[0].shape[::-1])
    for i, image in enumerate(images):
        cv2.imwrite(str(folder / f"{i:06}.png"), image)
        writer.write(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
    writer.release()
    (folder / "times.txt").write_text((turns / "times.txt").read_text())
    return folder, video


def assert_estimated(file, turns):
    """The lens of the distorted images; beside it the residuals before and after."""
    camera = yaml.safe_load(file.read_text())
    assert camera["estimated_from_drives"] is True and camera["distortion_model"] == "plumb_bob"
    assert camera["distortion_coefficients"]["data"][0] == pytest.approx(K1, abs=0.012)
    assert camera["camera_matrix"]["data"][0] == pytest.approx(camera_matrix(turns)[0, 0], rel=0.01)
    height, width = images_of(turns)[0].shape
    assert cv2.imread(str(file.with_suffix(".png"))).shape == (2 * height + 1, width, 3)
    return camera


def test_folder(gsv, gsv_command, distorted, turns, tmp_path):
    """The distortion of raw images is changed, the readout time copied; the other commands read both."""
    start = write_camera(tmp_path / "start.yaml", turns, D=[-0.03, 0, 0, 0, 0], readout_time=0.0001)
    status, output, messages = gsv_command("calibrate", distorted[0], "--camera", start, "--out", "lens.yaml")
    assert status == 0 and "turns: ok, " in output
    assert re.search(r"^k1 .* -0.03 ± .* -0.0\d+ ± ", output, re.MULTILINE), output
    assert assert_estimated(tmp_path / "lens.yaml", turns)["readout_time"] == 0.0001
    drive = gsv.open_drive(distorted[0], camera=tmp_path / "lens.yaml")
    assert drive.readout_time == 0.0001 and drive.camera.lens_is_estimated
    written = (tmp_path / "lens.yaml").read_bytes()
    status, _, messages = gsv_command("calibrate", distorted[0], "--camera", start, "--out", "lens.yaml")
    assert status == 1 and "lens.yaml exists already; --force replaces it" in messages
    assert (tmp_path / "lens.yaml").read_bytes() == written


def test_an_exact_calibration_is_kept(gsv_command, turns, tmp_path):
    status, output, _ = gsv_command("calibrate", turns)
    assert status == 0 and "the drives confirm the calibration" in output
    camera = yaml.safe_load((tmp_path / "camera.yaml").read_text())
    assert camera["distortion_coefficients"]["data"] == [0] * 5
    assert camera["camera_matrix"]["data"][0] == pytest.approx(camera_matrix(turns)[0, 0], abs=1e-5)


def test_video_without_calibration(gsv_command, distorted, turns, tmp_path):
    assert gsv_command("calibrate", distorted[1], "--fov", 75, "--set", "odometry/readout_time=0.0002")[0] == 0
    assert assert_estimated(tmp_path / "camera.yaml", turns)["readout_time"] == 0.0002


def test_dash_cam_without_calibration(gsv_command, turns, tmp_path):
    """The lens from its field of view and the drive, then the run."""
    K, images = camera_matrix(turns), images_of(turns)
    height, width = images[0].shape
    f, k1 = 1.4 * K[0, 0], -0.28
    new_K = np.array([[f, 0, (width - 1) / 2], [0, f, (height - 1) / 2], [0, 0, 1]])
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).astype(np.float64).reshape(-1, 1, 2)
    until_converged = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-9)
    points = cv2.undistortPointsIter(pixels, new_K, np.array([k1, 0, 0, 0]), None, None, until_converged).reshape(-1, 2)
    maps = (points * K[[0, 1], [0, 1]] + K[:2, 2]).reshape(height, width, 2).astype(np.float32)
    dash_cam = tmp_path / "dash_cam"
    dash_cam.mkdir()
    for i, image in enumerate(images):
        cv2.imwrite(str(dash_cam / f"{i:06}.png"), cv2.remap(image, maps, None, cv2.INTER_CUBIC))
    (dash_cam / "times.txt").write_text((turns / "times.txt").read_text())
    fov = 2 * np.degrees(np.arctan(-points[height // 2 * width, 0]))
    status, output, _ = gsv_command("run", dash_cam, "--fov", fov, "--out", "out", "--camera-height", CAMERA_HEIGHT)
    assert status == 0 and re.search(r"and \d\.\d % for the focal length, a common factor of all lengths", output), output
    camera = yaml.safe_load((tmp_path / "out/dash_cam/camera.yaml").read_text())
    assert camera["distortion_coefficients"]["data"][0] == pytest.approx(k1, abs=0.03)
    estimated, true = (np.linalg.norm(np.diff(poses_of(file)[:, :, 3], axis=0), axis=1).sum()
                       for file in (tmp_path / "out/dash_cam/poses.txt", turns / "poses.txt"))
    assert estimated == pytest.approx(true, rel=0.03)


def test_script_refuses_a_straight_drive(data, tmp_path):
    straight = rendered(data / "straight", "--frames", 60, "--size", "480x148", "--stop", 0, "--curvature", 0)
    assert_refused(1, "the lens is not observable: ", SCRIPTS / "calibrate_camera", straight, "--out", "lens.yaml",
                   cwd=tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("status, text, arguments", [
    (1, "slow.yaml cannot be used: readout_time [s] is 0.3", ["SHORTEST", "--camera", "slow.yaml"]),
    (1, "the images are 800x248, but size.yaml describes 480x148", ["SHORTEST", "--camera", "size.yaml"]),
    (1, "none: no such file", ["none", "--fov", 90]),
    (1, "there is no folder missing", ["SHORTEST", "--out", "missing/lens.yaml"]),
    (2, "rectified is for the camera_info of a bag, without a camera file or a field of view", ["SHORTEST", "--rectified", "--fov", 90]),
    (1, "none: no such file or folder", ["none"]),
    (2, "the field of view [degrees] is 5, it must lie in [10, 150]", ["SHORTEST", "--fov", 5]),
    (2, "lens.png is the name of the image", ["SHORTEST", "--out", "lens.png"]),
    (2, "direct/curvature_sigma", ["SHORTEST", "--set", "direct/curvature_sigma=1"]),
])
def test_refuses(gsv_command, shortest, turns, tmp_path, status, text, arguments):
    write_camera(tmp_path / "slow.yaml", shortest, readout_time=0.3)
    write_camera(tmp_path / "size.yaml", turns)
    done, _, message = gsv_command("calibrate", *(shortest if word == "SHORTEST" else word for word in arguments))
    assert done == status, message
    assert_one_sentence(text, message)


def test_smooth_estimates_the_lens_first(distorted, turns, tmp_path):
    """scripts/evaluate --smooth, also with a mask: the files have the lens and the scales of the whole drive."""
    start = write_camera(tmp_path / "start.yaml", turns, D=[-0.03, 0, 0, 0, 0])
    mask = tmp_path / "mask.png"
    cv2.imwrite(str(mask), np.full_like(images_of(turns)[0], 255))
    words = [distorted[0], "--camera", start, "--mask", mask, "--camera-height", CAMERA_HEIGHT]
    run(SCRIPTS / "evaluate", *words, "--out", tmp_path / "smoothed", "--smooth")
    run(tool("run_sequence"), *words, "--out", tmp_path / "causal")
    camera = yaml.safe_load((tmp_path / "smoothed/turns/camera.yaml").read_text())
    assert camera["distortion_coefficients"]["data"][0] == pytest.approx(K1, abs=0.012)
    assert camera["k1_sigma"] < 0.01
    unknown = {}
    for name in ("smoothed", "causal"):
        assert json.loads((tmp_path / name / "turns/metrics.json").read_text())["smoothed"] is (name == "smoothed")
        unknown[name] = (tmp_path / name / "turns/scale.csv").read_text().count(",unknown,")
    assert unknown["smoothed"] < unknown["causal"]


def test_smooth_keeps_a_calibration_that_the_drive_confirms(gsv_command, turns, tmp_path):
    assert gsv_command("run", turns, "--out", "out", "--camera-height", CAMERA_HEIGHT, "--smooth")[0] == 0
    assert json.loads((tmp_path / "out/turns/metrics.json").read_text())["smoothed"] is True
    assert not (tmp_path / "out/turns/camera.yaml").exists()
