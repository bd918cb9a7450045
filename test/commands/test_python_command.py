"""The command `ground_scale_vo run` of the Python package."""

import itertools
import json
import shutil

import bags
import cv2
import numpy as np
import pytest
from conftest import CAMERA_HEIGHT, FRAMES, assert_one_sentence, images_of, on_terminal, run, tool, write_camera
from std_msgs.msg import Float32


@pytest.fixture
def command(gsv_command):
    """As gsv_command, writes to tmp_path/out."""
    return lambda *arguments: gsv_command("run", "--out", "out", "--camera-height", CAMERA_HEIGHT, *arguments)


@pytest.fixture
def refused(command):
    def check(status, text, *arguments):
        done, _, message = command(*arguments)
        assert done == status, message
        assert_one_sentence(text, message)
    return check


def distance(results):
    """Between the first and last pose [m]."""
    return np.linalg.norm(np.loadtxt(results / "trajectory_tum.txt")[-1, 1:4])


def test_installed_command_on_a_terminal(venv, short, evaluated, tmp_path):
    output = on_terminal(venv / "bin/ground_scale_vo", "run", short, "--camera-height", CAMERA_HEIGHT, "--out",
                         tmp_path)
    assert f"short: {FRAMES}/{FRAMES} frames, " in output and f"short: {FRAMES} images, {FRAMES} used, 0 lost, {FRAMES} tracked; first metric pose after 0." in output
    results = tmp_path / "short"
    assert (results / "poses.txt").read_text() == (evaluated / "poses.txt").read_text()
    for file in ("trajectory.png", "scale.png", "timing.png", "report.html"):
        assert (results / file).stat().st_size > 0
    metrics = json.loads((results / "metrics.json").read_text())
    assert metrics["rle_percent"] is not None and metrics["height_bias_percent"] is not None


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


def test_options_reach_the_odometry(command, shortest, tmp_path):
    mask, height = tmp_path / "mask.png", 2 * CAMERA_HEIGHT
    pixels = 0 * images_of(shortest)[0]
    pixels[:4, :4] = 255
    cv2.imwrite(str(mask), pixels)
    _, output, _ = command(shortest, "--mask", mask, "--camera-height", height)
    assert "12 images, 12 used, 0 lost, 0 tracked; no metric pose" in output
    assert json.loads((tmp_path / "out/shortest/metrics.json").read_text())["camera_height_m"] == height


def test_preset_is_a_height_with_its_standard_deviation(gsv_command, shortest, tmp_path):
    given = ["--camera-height", 1.65, "--set", "camera_height_sigma=0.05"]
    texts = set()
    for words in (given, ["--preset", "kitti"]):
        assert gsv_command("run", shortest, "--out", "out", *words)[0] in (0, 1)
        texts.add("".join((tmp_path / "out/shortest" / name).read_text() for name in ("trajectory_tum.txt", "scale.csv")))
    assert len(texts) == 1 and ",0.05\n" in texts.pop()
    status, _, message = gsv_command("run", shortest, "--preset", "trabant")
    assert status == 2 and "there is no preset trabant, only kitti, nuscenes, " in message


def test_one_of_several_image_topics_must_be_named(command, refused, bag, short, evaluated, tmp_path):
    two = tmp_path / "two.bag"

    def black_beside_info(topic, message):
        if topic != bags.INFO:
            return topic, message
        width, height = message.width, message.height
        return "/other", bags.Image(message.header, height, width, "mono8", 0, width, bytes(width * height))

    bags.copy(bag, two, black_beside_info)
    refused(1, f"--image must be one of its image topics: {bags.IMAGE}, /other", two, "--camera", short / "calib.txt")
    refused(1, "; /tf holds tf2_msgs/TFMessage", two, "--camera", short / "calib.txt", "--image", "tf")
    assert command(two, "--camera", short / "calib.txt", "--image", bags.IMAGE.lstrip("/"))[0] == 0
    assert distance(tmp_path / "out/two") == pytest.approx(distance(evaluated))


def test_speeds_without_a_number_are_counted(refused, bag, tmp_path):
    played, numbers = tmp_path / "speeds.bag", itertools.cycle([1, 1, 1, float("nan")])
    bags.add_speed(bag, played, lambda stamp, speed: Float32(speed * next(numbers)))
    refused(0, f"10 of {FRAMES} speeds are not used: speed on {bags.SPEED} is not finite", played, "--rectified", "--speed",
            bags.SPEED, "--speed-unit", "mps")


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
    (2, "is it in centimetres? If not, set unusual_height true", ["SHORTEST", "--camera-height", 30]),
    (2, "--preset kitti and --camera-height are two heights: give one", ["SHORTEST", "--preset", "kitti"]),
    (2, "--camera FILE is missing", ["empty.mp4"]),
    (2, "the field of view [degrees] is 0, it must lie in [10, 150]", ["empty.mp4", "--fov", 0]),
    (2, "rectified is for the camera_info of a bag", ["SHORTEST", "--rectified"]),
    (1, "empty.mp4: is not a video", ["empty.mp4", "--camera", "CALIB"]),
    (1, "empty.mp4: is neither YAML of a camera nor a KITTI calib.txt", ["empty.mp4", "--camera", "empty.mp4"]),
    (1, "small.png is 8x4, the camera ", ["SHORTEST", "--camera", "raw.yaml", "--mask", "small.png"]),
])
def test_refuses(refused, shortest, tmp_path, status, text, arguments):
    (tmp_path / "empty.mp4").touch()
    write_camera(tmp_path / "raw.yaml", shortest, D=[-0.2, 0.05, 0, 0, 0])
    cv2.imwrite(str(tmp_path / "small.png"), np.full((4, 8), 255, np.uint8))
    words = {"CALIB": shortest / "calib.txt", "SHORTEST": shortest}
    refused(status, text, *(words.get(word, word) for word in arguments))
