"""kitti.launch, started with roslaunch: it plays the whole bag, or ends when it cannot."""

import re

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


def test_ends_when_it_cannot_play(bag, tmp_path):
    """What else playback_monitor and bag_recorder refuse: test_nodes.py."""
    log = tmp_path / "log"
    with roslaunch(log, "kitti.launch", f"bag:={bag}", "image:=/kitti/none") as (process, _):
        process.wait(TIMEOUT_S)
    assert "has no topic /kitti/none" in log.read_text() and "Traceback" not in log.read_text()
