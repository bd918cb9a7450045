"""scripts/demo: from a bag or a sequence to metrics and plots."""

import json
import os
import pathlib
import re
import signal
import subprocess

import bags
import pytest
from conftest import (SCRIPTS, TIMEOUT_S, assert_plays, assert_refused, on_full_disk, on_terminal,
                      pid_of, run, wait_until)

DEMO = SCRIPTS / "demo"


@pytest.mark.serial
def test_sequence_on_a_terminal(short, tmp_path):
    environment = {name: value for name, value in os.environ.items() if name != "DISPLAY"}
    output = on_terminal(DEMO, "--sequence", short, "--rviz", "--out", tmp_path,
                         environment=environment)
    assert re.search(r"there is no display.*set DISPLAY", output)
    assert re.search(r"\rshort: frame 40/40, .* Hz, .* m, scale .* m/unit \(.*\)",
                     output.replace("\x1b[K", "")), output
    assert "\nprogress: " not in output


@pytest.mark.serial
@pytest.mark.parametrize("layout", bags.LAYOUTS)
def test_bag_of_kitti2bag(bag, tmp_path, layout):
    played = tmp_path / "short.bag"
    bags.kitti2bag(layout, bag, played)
    assert_plays(DEMO, tmp_path, "--bag", played)
    metrics = json.loads((tmp_path / "short/metrics.json").read_text())
    assert metrics["gt_length_m"] and abs(metrics["rle_percent"]) < 5


def kill(node, number=signal.SIGKILL):
    def send(master):
        os.kill(pid_of(node, master), number)
    return send


def kill_roslaunch(master):
    """Its nodes and the master remain, as when a required node dies while roslaunch starts."""
    port = master.rsplit(":", 1)[1].rstrip("/")
    subprocess.run(["pkill", "-KILL", "-f", f"roslaunch -p {port} "], check=True)


PLAYER_STOPPED = r"rosbag play stopped before the end of the bag: \d+ of 40 frames"


@pytest.mark.parametrize("fail, infos, text", [
    (kill("/bag_player"), "all", PLAYER_STOPPED),
    (kill("/bag_player"), "one", PLAYER_STOPPED),
    (kill("/playback_monitor"), "all", "the run ended before the bag"),
    (kill("/ground_scale_vo_manager", signal.SIGSTOP), "all",
     r"the nodelets processed only \d+ of 40 frames"),
    (kill_roslaunch, "all", "the run ended before the bag"),
], ids=["player", "player_one_camera_info", "monitor", "nodelets_stopped", "roslaunch"])
def test_fails_when_aborted(bag, tmp_path, fail, infos, text):
    played = tmp_path / "short.bag"
    if infos == "one":
        bags.with_one_camera_info(bag, played)
    else:
        played.symlink_to(bag)
    log = tmp_path / "short/roslaunch.log"
    # So slowly that the bag does not end before the failure.
    demo = subprocess.Popen([str(DEMO), "--bag", str(played), "--out", str(tmp_path), "--rate", "0.5"],
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
    """Simulated by RLIMIT_FSIZE."""
    done = run(DEMO, "--bag", bag, "--out", tmp_path, check=False, **on_full_disk(64))
    message = f"{tmp_path}/short/recorded.bag cannot be written"
    assert done.returncode == 1 and message in done.stderr, done.stdout + done.stderr
    assert not list((tmp_path / "short").glob("recorded*"))
    assert not (tmp_path / "short/metrics.json").exists()


def test_truncated_bag(bag, tmp_path):
    truncated = tmp_path / "truncated.bag"
    truncated.write_bytes(bag.read_bytes()[:100000])
    assert_refused(1, "cannot be read", DEMO, "--out", tmp_path, "--bag", truncated)


def test_no_such_topic(bag, tmp_path):
    assert_refused(1, "has no topic /none", DEMO, "--out", tmp_path, "--bag", bag, "--image", "/none",
                   "--camera-height", "1.65")


@pytest.mark.serial
def test_compressed_images(bag, tmp_path):
    """Topics may be given with and without a slash."""
    played = tmp_path / "short.bag"
    bags.compress(bag, played)
    assert_plays(DEMO, tmp_path, "--bag", played, "--camera-height", "1.65", "--image",
                 bags.COMPRESSED.lstrip("/"), "--camera-info", "/" + bags.INFO.lstrip("/"))
    metrics = json.loads((tmp_path / "short/metrics.json").read_text())
    assert abs(metrics["rle_percent"]) < 5


def test_missing_tf(bag, tmp_path):
    done = run(DEMO, "--bag", bag, "--out", tmp_path, "--base-frame", "base_link", check=False)
    assert done.returncode == 1
    assert 'no tf transform from base_frame "base_link" to the camera frame' in done.stderr
    last_line = done.stderr.rstrip().splitlines()[-1]
    assert ("tf had no transform from the base frame to camera_gray_left (/tf of a bag is used as ground truth "
            "only: the mounting must be on /tf_static)") in last_line, done.stderr


@pytest.mark.parametrize("status, text, arguments", [
    (1, "there is no bag", ["--bag", "none.bag"]),
    (1, "no folder", ["--sequence", "none"]),
    (1, "empty", ["--sequence", "empty"]),
    (2, "--camera-height", ["--camera-height", "0"]),
    (2, "--camera-height", ["--camera-height", "-1.65"]),
    (2, "--camera-height", ["--camera-height", "high"]),
    (2, "--image camera/image needs --camera-height", ["--image", "camera/image"]),
    (2, "--nonsense", ["--nonsense"]),
])
def test_wrong_arguments(tmp_path, status, text, arguments):
    pathlib.Path(tmp_path, "empty").mkdir()
    assert_refused(status, text, DEMO, *arguments, cwd=tmp_path)


def test_arguments_reach_the_launch_file_and_the_tools(stub_tools, tmp_path):
    stubs = stub_tools("roslaunch", "evaluate_bag", "metrics_table.py", "plot_run.py")
    for name in ("x.bag", "m.png"):
        (tmp_path / name).touch()
    stubs["env"]["DISPLAY"] = ":7"

    def calls(*arguments):
        (tmp_path / "calls").unlink(missing_ok=True)
        run(DEMO, "--bag", "x.bag", "--out", "o", *arguments, **stubs)
        launch, *tools = (tmp_path / "calls").read_text().splitlines()
        return dict(word.split(":=") for word in launch.split() if ":=" in word), tools

    bag, out = tmp_path / "x.bag", tmp_path / "o/x"
    launched, tools = calls("--camera-height", "2.5", "--rate", "3", "--rviz", "--image", "/i", "--camera-info",
                            "/c", "--unrectified", "--mask", "m.png", "--base-frame", "base")
    expected = {"required": "true", "bag": str(bag), "camera_height": "2.5", "image": "/i", "camera_info": "/c",
                "image_is_rectified": "false", "rate": "3", "rviz": "true", "base_frame": "base",
                "mask": str(tmp_path / "m.png"), "record": f"{out}/recorded.bag"}
    assert launched == expected
    evaluate = f"evaluate_bag --played {bag} --recorded {out}/recorded.bag --out {out} --camera-height"
    assert tools == [f"{evaluate} 2.5 --image /i", f"metrics_table.py {out}", f"plot_run.py {out}"]
    assert calls("--rectified")[0]["image_is_rectified"] == "true"
    launched, tools = calls()
    del expected["image_is_rectified"]  # its default is that of the launch file
    assert launched == {**expected, "camera_height": "1.65", "image": "", "rate": "1", "mask": "", "rviz": "false",
                        "camera_info": "/kitti/camera_gray_left/camera_info", "base_frame": ""}
    assert tools[0] == f"{evaluate} 1.65"


def test_refuses_to_overwrite_the_input(stub_tools, tmp_path):
    """Also through a symbolic link."""
    stubs = stub_tools("kitti_to_bag", "roslaunch", "evaluate_bag", "metrics_table.py", "plot_run.py")
    results = tmp_path / "data/recorded"
    results.mkdir(parents=True)
    (results / "recorded.bag").touch()
    (tmp_path / "link").symlink_to(results.parent)
    for out in ("data", "link"):
        assert_refused(2, "own folder", DEMO, "--sequence", results, "--out", out, **stubs)
        assert_refused(2, "over the bag", DEMO, "--bag", results / "recorded.bag", "--out", out, **stubs)
    assert (results / "recorded.bag").exists()
