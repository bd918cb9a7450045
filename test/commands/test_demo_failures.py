"""scripts/demo when a part of it fails: it ends with status 1 and a reason, and leaves no results."""

import os
import re
import signal
import subprocess

import pytest
from conftest import SCRIPTS, TIMEOUT_S, assert_refused, on_full_disk, pid_of, run, wait_until

DEMO = SCRIPTS / "demo"


def kill(node, number=signal.SIGKILL):
    def send(master):
        os.kill(pid_of(node, master), number)
    return send


def kill_roslaunch(master):
    """Its nodes and the master remain, as when a required node dies while roslaunch starts."""
    port = master.rsplit(":", 1)[1].rstrip("/")
    subprocess.run(["pkill", "-KILL", "-f", f"roslaunch -p {port} "], check=True)


@pytest.mark.parametrize("fail, text", [
    (kill("/bag_player"), r"rosbag play stopped before the end of the bag: \d+ of 40 frames"),
    (kill("/playback_monitor"), "the run ended before the bag"),
    (kill("/ground_scale_vo_manager", signal.SIGSTOP), r"the nodelets processed only \d+ of 40 frames"),
    (kill_roslaunch, "the run ended before the bag"),
], ids=["player", "monitor", "nodelets_stopped", "roslaunch"])
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


def test_truncated_bag(bag, tmp_path):
    truncated = tmp_path / "truncated.bag"
    truncated.write_bytes(bag.read_bytes()[:100000])
    assert_refused(1, "cannot be read", DEMO, "--out", tmp_path, "--bag", truncated)
