"""kitti.launch, started with roslaunch: it ends when it cannot play the bag."""

import os
import pathlib
import re
import signal
import subprocess

import bags
import pytest
from conftest import ROOT, TIMEOUT_S, is_running, pid_of, roslaunch, wait_until, write_program


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    """Argument of the launch: queues so long that no frame is dropped on a busy machine."""
    folder = tmp_path_factory.mktemp("config")
    for file in (ROOT / "config").glob("*.yaml"):
        (folder / file.name).write_text(re.sub(r"(?m)^queue_size: \d+", "queue_size: 1000", file.read_text()))
    return f"config_dir:={folder}"


def test_player_ends_with_the_monitor(bag, tmp_path):
    log = tmp_path / "log"
    # So slowly that the bag does not end during the test.
    with roslaunch(log, "kitti.launch", f"bag:={bag}", "rate:=0.01") as (process, master):
        wait_until(lambda: "progress: " in log.read_text(), while_runs=process)
        player = pid_of("/bag_player", master)
        os.kill(pid_of("/playback_monitor", master), signal.SIGKILL)
        process.wait(TIMEOUT_S)
        assert not is_running(player)


def test_waits_for_both_nodelets(bag, config, tmp_path):
    """MonoVo starts last, and does not lose the first image."""
    released, wait = tmp_path / "released", tmp_path / "wait"
    write_program(wait, f'until [ -e {released} ]; do sleep 0.1; done\nexec "$@"')
    nodelets = (ROOT / "launch/ground_scale_vo.launch").read_text()
    (tmp_path / "nodelets.launch").write_text(
        nodelets.replace('name="mono_vo"', f'name="mono_vo" launch-prefix="{wait}"'))
    delayed = tmp_path / "delayed.launch"
    delayed.write_text((ROOT / "launch/kitti.launch").read_text().replace(
        "$(find ground_scale_vo)/launch/ground_scale_vo.launch", str(tmp_path / "nodelets.launch")))

    log = tmp_path / "log"
    with roslaunch(log, delayed, f"bag:={bag}", config) as (process, _):
        wait_until(lambda: "waits: no node publishes /vo/frame" in log.read_text(),
                   while_runs=process)
        released.touch()
        wait_until(lambda: "Playback finished: 40 of 40 frames" in log.read_text(), while_runs=process)


def test_continues_after_a_bag_without_ground_truth(bag, config, tmp_path):
    log, without = tmp_path / "log", tmp_path / "without.bag"
    bags.copy(bag, without, lambda topic, message: None if topic == "/tf" else (topic, message))
    with roslaunch(log, "kitti.launch", f"bag:={without}", config) as (process, master):
        wait_until(lambda: "Playback finished: 40 of 40 frames" in log.read_text(), while_runs=process)
        assert is_running(pid_of("/ground_scale_vo_manager", master))


def test_view_follows_a_camera_of_any_name(bag, tmp_path, monkeypatch):
    def rename(topic, message):
        if topic.startswith("/kitti"):
            message.header.frame_id = "front_camera"
        return topic, message

    monkeypatch.delenv("DISPLAY", raising=False)  # without it rviz ends, and the launch continues
    log, renamed = tmp_path / "log", tmp_path / "renamed.bag"
    bags.copy(bag, renamed, rename)
    config = (ROOT / "rviz/ground_scale_vo.rviz").read_text()
    target = re.search(r"Target Frame: (\S+)", config)[1]
    with roslaunch(log, "kitti.launch", f"bag:={renamed}", "rviz:=true") as (_, master):
        done = subprocess.run(["/usr/bin/python3", pathlib.Path(__file__).with_name("wait_for_frame.py"),
                               target], env={**os.environ, "ROS_MASTER_URI": master}, text=True,
                              stdout=subprocess.PIPE, timeout=TIMEOUT_S, check=True)
    assert done.stdout.splitlines()[-1] == "odom"


def test_record_keeps_an_existing_file(bag, tmp_path):
    """rosbag adds the extension."""
    log, old = tmp_path / "log", tmp_path / "old.bag"
    old.write_text("old")
    with roslaunch(log, "kitti.launch", f"bag:={bag}", f"record:={tmp_path}/old",
                   "required:=true") as (process, _):
        process.wait(TIMEOUT_S)
    assert f"{old} exists already" in log.read_text() and "Traceback" not in log.read_text()
    assert old.read_text() == "old" and sorted(tmp_path.iterdir()) == [log, old]


def test_ends_when_it_cannot_play(bag, tmp_path):
    """What else playback_monitor and bag_recorder refuse: test_nodes.py."""
    log = tmp_path / "log"
    with roslaunch(log, "kitti.launch", f"bag:={bag}", "image:=/kitti/none") as (process, _):
        process.wait(TIMEOUT_S)
    assert "has no topic /kitti/none; its topics with images are /kitti/camera_gray_left/image" in log.read_text()
    assert "Traceback" not in log.read_text()


def test_ends_without_a_bag(tmp_path):
    log = tmp_path / "log"
    with roslaunch(log, "kitti.launch") as (process, _):
        process.wait(TIMEOUT_S)
    assert "playback_monitor: bag:=FILE is missing" in log.read_text()
