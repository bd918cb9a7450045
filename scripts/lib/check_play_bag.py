#!/usr/bin/python3
"""Tests of nodes/play_bag without a master: bags that cannot be used, and a full disk."""

import importlib.machinery
import importlib.util
import os
import pathlib
import resource
import signal
import sys

from ground_scale_vo.msg import ScaleEstimate

IMAGE = "/kitti/camera_gray_left/image"
INFO = "/kitti/camera_gray_left/camera_info"


def load(path):
    loader = importlib.machinery.SourceFileLoader("play_bag", path)
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader("play_bag", loader))
    sys.dont_write_bytecode = True
    loader.exec_module(module)
    return module


def refusal(play_bag, action):
    try:
        action()
    except play_bag.Refused as refused:
        return str(refused)
    return "not refused"


def record(play_bag, path):
    """As much as the largest file may hold, many times over."""
    recorder = play_bag.Recorder(path)
    try:
        for i in range(3000):
            message = ScaleEstimate()
            message.header.stamp.secs = i + 1
            recorder.write("scale", message)
        recorder.close(complete=True)
    finally:
        recorder.close(complete=False)


def main():
    play_bag, good, folder = load(sys.argv[1]), sys.argv[2], pathlib.Path(sys.argv[3])
    failed = False

    def expect(holds, what):
        nonlocal failed
        if not holds:
            print(f"does not hold: {what}")
            failed = True

    count, _ = play_bag.inspect(good, IMAGE, INFO)
    expect(count > 0, "a good bag is taken")
    for bag in sorted(folder.glob("*.bag")):
        why = refusal(play_bag, lambda bag=bag: play_bag.inspect(str(bag), IMAGE, INFO))
        expect(str(bag) in why and "\n" not in why, f"{bag.name} is refused in one sentence: {why}")

    path = str(folder / "recorded.bag")
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    for size in (20000, 5000):  # within the chunks, and within the header
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
        why = refusal(play_bag, lambda: record(play_bag, path))
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        expect("recorded.bag cannot be written: File too large" in why, f"a full disk is said: {why}")
        expect(not [name for name in os.listdir(folder) if "recorded" in name], "nothing is left")
    record(play_bag, path)
    expect(os.path.isfile(path), "with room it is recorded")
    os.remove(path)
    sys.exit(failed)


if __name__ == "__main__":
    main()
