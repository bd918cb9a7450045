"""kitti.launch, started with roslaunch: it plays the whole bag, or ends when it cannot."""

import os
import re

import bags
import pytest
from conftest import FRAMES, ROOT, TIMEOUT_S, is_running, pid_of, roslaunch, run, wait_until, write_program

FINISHED = f"Playback finished: {FRAMES} of {FRAMES} frames"


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    """Argument of the launch: queues so long that no frame is dropped on a busy machine."""
    folder = tmp_path_factory.mktemp("config")
    for file in (ROOT / "config").glob("*.yaml"):
        (folder / file.name).write_text(re.sub(r"(?m)^queue_size: \d+", "queue_size: 1000", file.read_text()))
    return f"config_dir:={folder}"


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
        wait_until(lambda: "waits: no node publishes /vo/frame" in log.read_text(), while_runs=process)
        released.touch()
        wait_until(lambda: FINISHED in log.read_text(), while_runs=process)


def test_any_frame_and_no_ground_truth(bag, config, tmp_path, monkeypatch):
    """The view follows the camera, and the launch continues after the bag."""
    def change(topic, message):
        if topic == "/tf":
            return None
        message.header.frame_id = "front_camera"
        return topic, message

    monkeypatch.delenv("DISPLAY", raising=False)  # without it rviz ends, and the launch continues
    log, changed = tmp_path / "log", tmp_path / "changed.bag"
    bags.copy(bag, changed, change)
    target = re.search(r"Target Frame: (\S+)", (ROOT / "rviz/ground_scale_vo.rviz").read_text())[1]
    with roslaunch(log, "kitti.launch", f"bag:={changed}", "rviz:=true", config) as (process, master):
        wait_until(lambda: "progress: " in log.read_text(), while_runs=process)
        condition = f"any(t.child_frame_id == '{target}' for t in m.transforms)"
        message = run("rostopic", "echo", "-n", 1, "--filter", condition, "/tf",
                      env={**os.environ, "ROS_MASTER_URI": master}).stdout
        assert 'frame_id: "odom"' in message
        wait_until(lambda: FINISHED in log.read_text(), while_runs=process)
        assert is_running(pid_of("/ground_scale_vo_manager", master))


@pytest.mark.parametrize("arguments, text", [
    ("image:=/kitti/none", f"has no topic /kitti/none; its topics with images are {bags.IMAGE}"),
    ("record:=OLD required:=true", "old.bag exists already"),
])
def test_ends_when_it_cannot_play(bag, tmp_path, arguments, text):
    """What else playback_monitor and bag_recorder refuse: test_nodes.py."""
    log, old = tmp_path / "log", tmp_path / "old.bag"
    old.write_text("old")
    words = arguments.replace("OLD", str(old)).split()
    with roslaunch(log, "kitti.launch", f"bag:={bag}", *words) as (process, _):
        process.wait(TIMEOUT_S)
    assert text in log.read_text() and "Traceback" not in log.read_text()
    assert old.read_text() == "old" and sorted(tmp_path.iterdir()) == [log, old]
