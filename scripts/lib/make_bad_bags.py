#!/usr/bin/python3
"""Writes bags that are damaged or hold other things than they should, made of a good one."""

import pathlib
import random
import sys

import rosbag
import rospy
from std_msgs.msg import String

IMAGE = "/kitti/camera_gray_left/image"
INFO = "/kitti/camera_gray_left/camera_info"


def main():
    good, folder = sys.argv[1], pathlib.Path(sys.argv[2])
    data = pathlib.Path(good).read_bytes()
    (folder / "empty_file.bag").write_bytes(b"")
    (folder / "cut.bag").write_bytes(data[: len(data) // 2])
    # The records of the index follow the chunks; the header of the bag says where.
    index = int.from_bytes(data[data.find(b"index_pos=") + 10 :][:8], "little")
    (folder / "no_index.bag").write_bytes(data[:index])
    noise = bytearray(data)
    noise[5000:] = random.Random(1).randbytes(len(noise) - 5000)
    (folder / "noise.bag").write_bytes(noise)
    with rosbag.Bag(str(folder / "no_messages.bag"), "w"):
        pass
    with rosbag.Bag(str(folder / "text_topic.bag"), "w") as bag:
        for topic in (IMAGE, INFO):
            bag.write(topic, String("no image"), rospy.Time(1))


if __name__ == "__main__":
    main()
