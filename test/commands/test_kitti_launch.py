"""kitti.launch, started with roslaunch: it ends when it cannot play the bag."""

import os
import signal

import pytest
from conftest import TIMEOUT_S, is_running, pid_of, roslaunch, wait_until


pytestmark = pytest.mark.serial


def test_player_ends_with_the_monitor(bag, tmp_path):
    log = tmp_path / "log"
    # So slowly that the bag does not end during the test.
    with roslaunch(log, "kitti.launch", f"bag:={bag}", "rate:=0.01") as (process, master):
        wait_until(lambda: "progress: " in log.read_text(), while_runs=process)
        player = pid_of("/bag_player", master)
        os.kill(pid_of("/playback_monitor", master), signal.SIGKILL)
        process.wait(TIMEOUT_S)
        assert not is_running(player)


def test_continues_after_the_bag(bag, tmp_path):
    log = tmp_path / "log"
    with roslaunch(log, "kitti.launch", f"bag:={bag}") as (process, master):
        wait_until(lambda: "Playback finished: 40 of 40 frames" in log.read_text(), while_runs=process)
        assert is_running(pid_of("/ground_scale_vo_manager", master))


@pytest.mark.parametrize("argument, text", [
    ("bag:=/there/is/none.bag", "there is no bag /there/is/none.bag"),
    ("image:=/none", "has no topic /none; its topics with images are "
                     "/kitti/camera_gray_left/image"),
    ("camera_info:=/none", "has no topic /none; its topics with camera_info are "
                           "/kitti/camera_gray_left/camera_info"),
    ("rate:=abc", "the rate is 'abc', it must be a positive number"),
    ("rate:=0", "the rate is '0', it must be a positive number"),
])
def test_ends_when_it_cannot_play(bag, tmp_path, argument, text):
    log = tmp_path / "log"
    with roslaunch(log, "kitti.launch", f"bag:={bag}", argument) as (process, _):
        process.wait(TIMEOUT_S)
    assert text in log.read_text() and "Traceback" not in log.read_text()
