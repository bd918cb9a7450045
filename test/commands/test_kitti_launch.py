"""kitti.launch, started with roslaunch: it plays the whole bag, or ends when it cannot."""

import os
import re
import shlex

import bags
import pytest
from conftest import FRAMES, ROOT, TIMEOUT_S, roslaunch, wait_until

FINISHED = f"Playback finished: {FRAMES} of {FRAMES} frames"


def test_waits_for_both_nodelets(bag, tmp_path):
    """MonoVo starts last, and does not lose the first image. The queues are so long that no frame is dropped on a
    busy machine."""
    for file in (ROOT / "config").glob("*.yaml"):
        (tmp_path / file.name).write_text(re.sub(r"(?m)^queue_size: \d+", "queue_size: 1000", file.read_text()))
    released, wait = tmp_path / "released", tmp_path / "wait"
    wait.write_text(f'#!/bin/bash\nuntil [ -e {released} ]; do sleep 0.1; done\nexec "$@"\n')
    wait.chmod(0o755)
    nodelets = (ROOT / "launch/ground_scale_vo.launch").read_text()
    (tmp_path / "nodelets.launch").write_text(
        nodelets.replace('name="mono_vo"', f'name="mono_vo" launch-prefix="{wait}"'))
    delayed = tmp_path / "delayed.launch"
    delayed.write_text((ROOT / "launch/kitti.launch").read_text().replace(
        "$(find ground_scale_vo)/launch/ground_scale_vo.launch", str(tmp_path / "nodelets.launch")))

    log = tmp_path / "log"
    with roslaunch(log, delayed, f"bag:={bag}", f"config_dir:={tmp_path}") as (process, _):
        wait_until(lambda: "waits: no node publishes /vo/frame" in log.read_text(), while_runs=process)
        released.touch()
        wait_until(lambda: FINISHED in log.read_text(), while_runs=process)


def test_parts_of_a_bag_with_other_names(bag, tmp_path, monkeypatch):
    """And with another Python first in the path."""
    halves, other, log = bags.split(bag, tmp_path), tmp_path / "python3", tmp_path / "log"
    other.write_text("#!/bin/sh\nexit 1\n")
    other.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    recorded = halves[0].with_name("it's recorded.bag")
    with roslaunch(log, "kitti.launch", f"bag:={' '.join(map(shlex.quote, map(str, halves)))}", "image:=camera/jpeg",
                   "camera_height:=1.65", "image_is_rectified:=true", f"record:={recorded}",
                   "required:=true") as (process, _):
        process.wait(TIMEOUT_S)
    assert re.search(rf"Playback finished: \d+ of {FRAMES} frames", log.read_text()) and recorded.exists()


@pytest.mark.parametrize("image, text", [
    ("/kitti/none", "has no topic /kitti/none"), (bags.INFO, "holds sensor_msgs/CameraInfo instead of sensor_msgs/Image")])
def test_ends_when_it_cannot_play(bag, tmp_path, image, text):
    """What else playback_monitor and bag_recorder refuse: test_nodes.py."""
    log = tmp_path / "log"
    with roslaunch(log, "kitti.launch", f"bag:={bag}", f"image:={image}") as (process, _):
        process.wait(TIMEOUT_S)
    assert text in log.read_text() and not re.search("Traceback|FATAL", log.read_text())
