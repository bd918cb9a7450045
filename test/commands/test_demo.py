"""scripts/demo: from a bag or a sequence to metrics and plots. When a part of it fails, it ends with status 1 and a
reason, and leaves no results."""

import json
import os
import re
import signal
import subprocess

import bags
import pytest
import rospy
from conftest import (CAMERA_HEIGHT, SCRIPTS, TIMEOUT_S, assert_played, assert_refused, on_full_disk, on_terminal, pid_of, run,
                      wait_until, write_camera)
from geometry_msgs.msg import TwistStamped
from std_msgs.msg import Float32, Float64

DEMO = SCRIPTS / "demo"


def test_bag_on_a_terminal(bag, tmp_path):
    environment = {name: value for name, value in os.environ.items() if name != "DISPLAY"}
    output = on_terminal(DEMO, "--bag", bag, "--rviz", "--out", tmp_path, environment=environment)
    assert re.search(r"there is no display.*set DISPLAY", output)
    assert re.search(r"\rshort: frame \d\d/40, .* Hz, .* m, scale .* m/unit \(.*\)",
                     output.replace("\x1b[K", "")), output
    assert_played(output, tmp_path / "short")
    assert abs(json.loads((tmp_path / "short/metrics.json").read_text())["rle_percent"]) < 5


def test_raw_drive_of_kitti2bag(bag, tmp_path):
    """`bag` is an odometry sequence."""
    played = tmp_path / "short.bag"
    bags.raw_drive(bag, played)
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


def test_parts_of_a_bag_with_other_names(bag, tmp_path):
    """Another Python is first in the path."""
    halves, other = bags.split(bag, tmp_path), tmp_path / "python3"
    other.write_text("#!/bin/sh\nexit 1\n")
    other.chmod(0o755)
    out = tmp_path / "it's out"
    done = run(DEMO, "--out", out, "--bag", *halves[::-1], "--preset", "kitti", "--image", "/camera/jpeg",
               "--rectified", env={**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"})
    assert_played(done.stdout, out / "my half's 2")
    metrics = json.loads((out / "my half's 2/metrics.json").read_text())
    assert metrics["rle_percent"] is not None and metrics["camera_height_m"] == 1.65
    assert '<img src="data:image/jpeg' in (out / "my half's 2/report.html").read_text()


def test_speed_and_camera_file_instead_of_height_and_camera_info(bag, short, tmp_path):
    played, with_info, camera = tmp_path / "short.bag", tmp_path / "all.bag", write_camera(tmp_path / "camera.yaml", short)
    bags.add_speed(bag, with_info, bags.speed_of(Float64, 3.6))
    bags.copy(with_info, played, lambda topic, message: None if topic == bags.INFO else (topic, message))
    done = run(DEMO, "--out", tmp_path, "--bag", played, "--camera", camera, "--speed", bags.SPEED, "--speed-unit", "kmh")
    assert_played(done.stdout, tmp_path / "short")
    metrics = json.loads((tmp_path / "short/metrics.json").read_text())
    assert abs(metrics["rle_percent"]) < 2 and abs(metrics["learned_camera_height_m"] - CAMERA_HEIGHT) < 0.1


def zeroed(topic, message):
    if topic == bags.INFO:
        message.P = [0.0] * 12
    return topic, message


def late(stamp, speed):
    return bags.speed_of(TwistStamped, 1)(stamp + rospy.Duration(100), speed)


@pytest.mark.parametrize("make, options, status, text", [
    (None, ("--camera-height", 30), 2, "camera_height is 30 m, on a road vehicle it is 0.2 to 5 m: is it in centimetres?"),
    (None, ("--preset", "trabant"), 2, "there is no preset trabant, only kitti, nuscenes, "),
    (None, ("--preset", "kitti", "--camera-height", 2), 2, "--camera-height: not allowed with argument --preset"),
    (None, ("--image", "/cam/image", "--camera-height", 2), 1,
     f"has no topic /cam/image; its topics with images are {bags.IMAGE}: choose one with --image TOPIC"),
    (None, ("--speed", "/nope"), 1, "has no topic /nope; it has no speed, only"),
    (None, ("--camera-info", "/lens/info"), 1, f"its topics with camera_info are {bags.INFO}: choose one with --camera-info TOPIC"),
    (bags.speed_of(Float32, 1), ("--speed", bags.SPEED), 1, "unit is not known: --speed-unit mps, kmh, mph, knots or mmps is"),
    (late, ("--speed", bags.SPEED), 1, "no speed is used: the images are from "),
    (zeroed, (), 1, "is all zeros: the camera is not calibrated"),
])
def test_refuses_before_ros_starts(bag, short, gsv_command, tmp_path, make, options, status, text):
    """What an earlier run has written stays."""
    played, results = tmp_path / "drive.bag", tmp_path / "out/drive"
    if make is zeroed:
        bags.copy(bag, played, make)
    elif make:
        bags.add_speed(bag, played, make)
    else:
        played.symlink_to(bag)
    results.mkdir(parents=True)
    old = [results / name for name in ("metrics.json", "poses.txt", "report.html", "roslaunch.log", "recorded.bag")]
    for file in old:
        file.write_text(file.name)
    assert_refused(status, text, DEMO, "--bag", played, "--out", tmp_path / "out", *options)
    assert sorted(results.iterdir()) == sorted(old) and all(file.read_text() == file.name for file in old)
    if "centimetres" in text:
        assert text in gsv_command("run", short, *options)[2]


def test_missing_tf(bag, tmp_path):
    done = run(DEMO, "--bag", bag, "--out", tmp_path, "--base-frame", "base_link", check=False)
    assert done.returncode == 1
    assert 'no tf transform from base_frame "base_link" to the camera frame' in done.stderr
    assert "the mounting must be on /tf_static" in done.stderr.rstrip().splitlines()[-1], done.stderr


def kill(node, number=signal.SIGKILL):
    def send(master):
        os.kill(pid_of(node, master), number)
    return send


@pytest.mark.parametrize("fail, text", [
    (kill("/bag_player"), r"rosbag play stopped before the end of the bag: \d+ of 40 frames"),
    (kill("/ground_scale_vo_manager", signal.SIGSTOP), r"the nodelets processed only \d+ of 40 frames"),
    (kill("/playback_monitor"), "the run ended before the bag"),
], ids=["player", "nodelets_stopped", "monitor"])
def test_fails_when_aborted(bag, tmp_path, fail, text):
    log = tmp_path / "short/roslaunch.log"
    # So slowly that the bag does not end before the failure.
    demo = subprocess.Popen([str(DEMO), "--bag", str(bag), "--out", str(tmp_path), "--rate", "0.5"],
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        wait_until(lambda: log.exists() and "progress: " in log.read_text(errors="replace"),
                   while_runs=demo)
        fail(re.search(r"ROS_MASTER_URI=(http://[\w.:-]+)", log.read_text())[1])
        stdout, stderr = demo.communicate(timeout=TIMEOUT_S)
    finally:
        demo.terminate()
    assert demo.returncode == 1, stdout + stderr
    assert re.search(text, stderr), stderr
    assert not list(log.parent.glob("recorded*")) and not (log.parent / "metrics.json").exists()


def test_full_disk(bag, tmp_path):
    done = run(DEMO, "--bag", bag, "--out", tmp_path, check=False, **on_full_disk(64))
    message = f"{tmp_path}/short/recorded.bag cannot be written"
    assert done.returncode == 1 and message in done.stderr, done.stdout + done.stderr
    assert not list((tmp_path / "short").glob("recorded*"))
    assert not (tmp_path / "short/metrics.json").exists()
