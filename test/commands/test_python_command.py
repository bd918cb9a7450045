"""The command `ground_scale_vo run` of the Python package."""

import importlib
import json
import shutil
import sys

import bags
import cv2
import numpy as np
import pytest
from conftest import (CAMERA_HEIGHT, FRAMES, assert_one_sentence, camera_matrix, distorted_images_of, images_of,
                      on_terminal, run, tool, write_camera)


@pytest.fixture
def command(gsv, tmp_path, monkeypatch, capfd):
    """command(ARGUMENT...): its exit status and output, and what it wrote to stderr. In this process: the start
    of another takes a second. It runs in tmp_path and writes to tmp_path/out."""
    def call(*arguments):
        monkeypatch.chdir(tmp_path)
        words = ["ground_scale_vo", "run", "--out", "out", "--camera-height", CAMERA_HEIGHT, *arguments]
        monkeypatch.setattr(sys, "argv", [str(word) for word in words])
        status = importlib.import_module("ground_scale_vo.command_line").main()
        output = capfd.readouterr()
        return status, output.out, output.err
    return call


@pytest.fixture
def refused(command):
    def check(status, text, *arguments):
        done, _, message = command(*arguments)
        assert done == status, message
        assert_one_sentence(text, message)
    return check


def write_kalibr(file, intrinsics, size, model="radtan", D=()):
    file.write_text(json.dumps({"cam0": {"camera_model": "pinhole", "intrinsics": list(intrinsics), "resolution": size,
                                         "distortion_model": model, "distortion_coeffs": list(D)}}))
    return file


def distance(results):
    """Between the first and last pose [m]."""
    return np.linalg.norm(np.loadtxt(results / "trajectory_tum.txt")[-1, 1:4])


def test_installed_command_on_a_terminal(venv, short, evaluated, tmp_path):
    output = on_terminal(venv / "bin/ground_scale_vo", "run", short, "--camera-height", CAMERA_HEIGHT, "--out",
                         tmp_path)
    assert f"short: {FRAMES}/{FRAMES} frames, " in output and f"short: {FRAMES} images, {FRAMES} used, 0 lost, {FRAMES} tracked; first metric pose after 0." in output
    results = tmp_path / "short"
    assert (results / "poses.txt").read_text() == (evaluated / "poses.txt").read_text()
    for plot in ("trajectory", "scale", "timing"):
        assert (results / f"{plot}.png").stat().st_size > 0
    metrics = json.loads((results / "metrics.json").read_text())
    assert metrics["rle_percent"] is not None and metrics["height_bias_percent"] is not None


def test_bag(command, bag, short, evaluated, tmp_path):
    status, output, messages = command(bag, "--camera", short / "calib.txt")
    assert status == 0 and f"short: {FRAMES} images" in output and not messages
    assert (tmp_path / "out/short/poses.txt").read_text() == (evaluated / "poses.txt").read_text()


@pytest.mark.parametrize("model, D", [("radtan", [-0.2, 0.05, 0.001, -0.001]), ("equidistant", [-0.05, 0.01, 0, 0])])
def test_folder_of_distorted_images(command, short, evaluated, tmp_path, model, D):
    folder, K = tmp_path / "raw", camera_matrix(short)
    folder.mkdir()
    (folder / "times.txt").write_text((short / "times.txt").read_text())
    images = distorted_images_of(short, D, model == "equidistant")
    for i, image in enumerate(images):
        cv2.imwrite(str(folder / f"{i:06}.png"), image)
    file = write_kalibr(tmp_path / "camera.yaml", K[[0, 1, 0, 1], [0, 1, 2, 2]], images[0].shape[::-1], model, D)
    assert command(folder, "--camera", file)[0] == 0
    assert distance(tmp_path / "out/raw") == pytest.approx(distance(evaluated), rel=0.01)


def test_camera_file_as_in_the_offline_tools(command, short, evaluated, tmp_path):
    """Distortion, what is outside the raw image, readout time unless it is set, and that the lens is estimated."""
    file = write_camera(tmp_path / "camera.yaml", short, D=[0.03, 0, 0, 0, 0], estimated_from_drives=True,
                        readout_time=0.05)
    results = {evaluated: (evaluated / "poses.txt").read_text()}
    for options in ([], ["--set", "odometry/readout_time=0.0"]):
        words = [short, "--camera", file, *options]
        run(tool("run_sequence"), *words, "--camera-height", CAMERA_HEIGHT, "--out", tmp_path)
        assert command(*words)[0] == 0
        poses = (tmp_path / "short/poses.txt").read_text()
        assert (tmp_path / "out/short/poses.txt").read_text() == poses
        assert poses not in results.values()
        results[str(options)] = poses


def test_options_reach_the_odometry(gsv, command, shortest, tmp_path):
    mask, height = tmp_path / "mask.png", 2 * CAMERA_HEIGHT
    cv2.imwrite(str(mask), 0 * images_of(shortest)[0])
    _, output, _ = command(shortest, "--mask", mask, "--camera-height", height)
    assert "12 images, 12 used, 0 lost, 0 tracked; no metric pose" in output
    assert json.loads((tmp_path / "out/shortest/metrics.json").read_text())["camera_height_m"] == height
    parse = importlib.import_module("ground_scale_vo.command_line").parse
    arguments = parse("run x --camera-height 1 --set refine=false --set a=true --set tracker/cell_size=0.02".split())
    assert arguments.set == ["refine=false", "a=true", "tracker/cell_size=0.02"]


def test_one_of_several_image_topics_must_be_named(command, refused, bag, short, evaluated, tmp_path):
    two = tmp_path / "two.bag"

    def black_beside_info(topic, message):
        if topic != bags.INFO:
            return topic, message
        width, height = message.width, message.height
        return "/other", bags.Image(message.header, height, width, "mono8", 0, width, bytes(width * height))

    bags.copy(bag, two, black_beside_info)
    refused(1, f"--image must be one of its image topics: {bags.IMAGE}, /other", two, "--camera", short / "calib.txt")
    assert command(two, "--camera", short / "calib.txt", "--image", bags.IMAGE.lstrip("/"))[0] == 0
    assert distance(tmp_path / "out/two") == pytest.approx(distance(evaluated))


def test_unusable_bags_are_refused(refused, bag, damaged_bag, short, tmp_path):
    refused(1, f"{damaged_bag}: ", damaged_bag, "--camera", short / "calib.txt")
    images = tmp_path / "images.bag"
    bags.copy(bag, images, lambda topic, message: None if topic == bags.INFO else (topic, message))
    refused(2, f"--camera is missing; {images} has no {bags.INFO}", images)


def test_refuses_to_overwrite_the_input(refused, shortest, tmp_path):
    shutil.copytree(shortest, tmp_path / "drive")
    refused(2, "would write the results to the input", "drive", "--out", ".")
    assert (tmp_path / "drive/poses.txt").read_text() == (shortest / "poses.txt").read_text()


@pytest.mark.parametrize("status, text, arguments", [
    (1, "none: no such file or folder", ["none", "--camera", "CALIB"]),
    (2, "--camera FILE is missing", ["empty.mp4"]),
    (2, "rectified is for the camera_info of a bag", ["SHORTEST", "--rectified"]),
    (1, "empty.mp4: is not a video", ["empty.mp4", "--camera", "CALIB"]),
    (1, "empty.mp4: is neither YAML of a camera nor a KITTI calib.txt", ["empty.mp4", "--camera", "empty.mp4"]),
    (1, "size.yaml describes 810x250", ["SHORTEST", "--camera", "size.yaml"]),
    (1, "small.png is 8x4, the camera ", ["SHORTEST", "--camera", "raw.yaml", "--mask", "small.png"]),
])
def test_refuses(refused, shortest, tmp_path, status, text, arguments):
    (tmp_path / "empty.mp4").touch()
    write_kalibr(tmp_path / "raw.yaml", (500, 500, 400, 120), (800, 248), D=[-0.2, 0.05, 0, 0])
    write_kalibr(tmp_path / "size.yaml", (500, 500, 400, 120), (810, 250), D=[0, 0, 0, 0])
    cv2.imwrite(str(tmp_path / "small.png"), np.full((4, 8), 255, np.uint8))
    words = {"CALIB": shortest / "calib.txt", "SHORTEST": shortest}
    refused(status, text, *(words.get(word, word) for word in arguments))
