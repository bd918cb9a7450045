"""bag.launch plays the whole bag. What it refuses: test_doors.py and test_nodes.py; parts of a bag: test_demo.py."""

import re

from conftest import FRAMES, ROOT, roslaunch, wait_until


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
    delayed.write_text((ROOT / "launch/bag.launch").read_text().replace(
        "$(find ground_scale_vo)/launch/ground_scale_vo.launch", str(tmp_path / "nodelets.launch")))

    log = tmp_path / "log"
    arguments = ["image:=/kitti/camera_gray_left/image_rect", "image_is_rectified:=true", "camera_height:=1.65"]
    with roslaunch(log, delayed, f"bag:={bag}", *arguments, f"config_dir:={tmp_path}") as (process, _):
        wait_until(lambda: "waits: no node publishes /vo/frame" in log.read_text(), while_runs=process)
        released.touch()
        wait_until(lambda: f"Playback finished: {FRAMES} of {FRAMES} frames" in log.read_text(), while_runs=process)
