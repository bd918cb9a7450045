"""scripts/demo: from a bag or a sequence to metrics and plots."""

import json
import os
import re

import bags
import pytest
from conftest import SCRIPTS, assert_played, assert_refused, on_terminal, run

DEMO = SCRIPTS / "demo"


def test_bag_on_a_terminal(bag, tmp_path):
    environment = {name: value for name, value in os.environ.items() if name != "DISPLAY"}
    output = on_terminal(DEMO, "--bag", bag, "--rviz", "--out", tmp_path, environment=environment)
    assert re.search(r"there is no display.*set DISPLAY", output)
    assert re.search(r"\rshort: frame \d\d/40, .* Hz, .* m, scale .* m/unit \(.*\)",
                     output.replace("\x1b[K", "")), output
    assert_played(output, tmp_path / "short")
    assert abs(json.loads((tmp_path / "short/metrics.json").read_text())["rle_percent"]) < 5


@pytest.mark.parametrize("layout", bags.LAYOUTS)
def test_other_bag_of_kitti2bag(bag, tmp_path, layout):
    """`bag` is an odometry sequence of the current version."""
    played = tmp_path / "short.bag"
    bags.kitti2bag(layout, bag, played)
    assert_played(run(DEMO, "--out", tmp_path, "--bag", played).stdout, tmp_path / "short")
    metrics = json.loads((tmp_path / "short/metrics.json").read_text())
    assert metrics["gt_length_m"] and abs(metrics["rle_percent"]) < 5


def test_compressed_images_and_another_height(bag, tmp_path):
    """The length is proportional to the height. Topics may be given with and without a slash."""
    played = tmp_path / "short.bag"
    bags.compress(bag, played)
    output = run(DEMO, "--out", tmp_path, "--bag", played, "--camera-height", 3.3, "--rate", 0.8, "--image",
                 bags.COMPRESSED.lstrip("/"), "--camera-info", "/" + bags.INFO.lstrip("/")).stdout
    assert_played(output, tmp_path / "short")
    metrics = json.loads((tmp_path / "short/metrics.json").read_text())
    assert metrics["camera_height_m"] == 3.3 and 90 < metrics["rle_percent"] < 110


def test_missing_tf(bag, tmp_path):
    done = run(DEMO, "--bag", bag, "--out", tmp_path, "--base-frame", "base_link", check=False)
    assert done.returncode == 1
    assert 'no tf transform from base_frame "base_link" to the camera frame' in done.stderr
    assert "the mounting must be on /tf_static" in done.stderr.rstrip().splitlines()[-1], done.stderr


@pytest.mark.parametrize("status, text, arguments", [
    (1, "there is no bag", ["--bag", "none.bag"]),
    (1, "no folder", ["--sequence", "none"]),
    (1, "empty", ["--sequence", "empty"]),
    (2, "--camera-height", ["--camera-height", "-1.65"]),
    (2, "--camera-height", ["--camera-height", "0"]),
    (2, "--image camera/image needs --camera-height", ["--image", "camera/image"]),
    (2, "own folder", ["--sequence", "data/recorded", "--out", "link"]),
    (2, "over the bag", ["--bag", "data/recorded/recorded.bag", "--out", "link"]),
])
def test_refuses(tmp_path, status, text, arguments):
    """Does not overwrite the input, also not through a symbolic link."""
    for folder in ("empty", "data/recorded"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "data/recorded/recorded.bag").touch()
    (tmp_path / "link").symlink_to("data")
    assert_refused(status, text, DEMO, *arguments, cwd=tmp_path)
    assert (tmp_path / "data/recorded/recorded.bag").exists()
