"""Writes bags for the command tests: damaged ones, and one with GPS fixes."""

import math
import random

import rosbag
import rospy
from sensor_msgs.msg import NavSatFix
from std_msgs.msg import String

IMAGE = "/kitti/camera_gray_left/image"
INFO = "/kitti/camera_gray_left/camera_info"

LATITUDE_DEG, LONGITUDE_DEG = 49.0, 8.0
NORTH_M, EAST_M = 111200.5, 73172.0  # of one degree there (WGS84)


def _empty_file(_, file):
    file.touch()


def _truncated(good, file):
    data = good.read_bytes()
    file.write_bytes(data[: len(data) // 2])


def _no_index(good, file):
    data = good.read_bytes()
    # The index follows the chunks; the bag's header holds its position.
    index = int.from_bytes(data[data.find(b"index_pos=") + 10 :][:8], "little")
    file.write_bytes(data[:index])


def _noise(good, file):
    data = bytearray(good.read_bytes())
    count = len(data) - 5000
    data[5000:] = random.Random(1).getrandbits(8 * count).to_bytes(count, "little")
    file.write_bytes(data)


def _no_messages(_, file):
    with rosbag.Bag(str(file), "w"):
        pass


def _text_topic(_, file):
    with rosbag.Bag(str(file), "w") as bag:
        for topic in (IMAGE, INFO):
            bag.write(topic, String("no image"), rospy.Time(1))


# name -> function(a good bag, the file to write)
DAMAGED = {
    "empty_file": _empty_file,
    "truncated": _truncated,
    "no_index": _no_index,
    "noise": _noise,
    "no_messages": _no_messages,
    "text_topic": _text_topic,
}


def add_fixes(bag_file, poses_file):
    """Adds an exact GPS fix (/fix, sigma 0.02 m) for each image, from KITTI poses."""
    with open(poses_file, encoding="ascii") as lines:
        poses = [[float(word) for word in line.split()] for line in lines]
    with rosbag.Bag(str(bag_file)) as bag:
        stamps = [message.header.stamp for _, message, _ in bag.read_messages(topics=[IMAGE])]
    heading = math.radians(30)
    with rosbag.Bag(str(bag_file), "a") as bag:
        for stamp, pose in zip(stamps, poses):
            right, down, forward = pose[3], pose[7], pose[11]
            fix = NavSatFix()
            fix.header.stamp = stamp
            east = forward * math.cos(heading) + right * math.sin(heading)
            north = forward * math.sin(heading) - right * math.cos(heading)
            fix.latitude = LATITUDE_DEG + north / NORTH_M
            fix.longitude = LONGITUDE_DEG + east / EAST_M
            fix.altitude = 110.0 - down
            fix.position_covariance = [0.0004, 0, 0, 0, 0.0004, 0, 0, 0, 0.0016]
            fix.position_covariance_type = NavSatFix.COVARIANCE_TYPE_DIAGONAL_KNOWN
            bag.write("/fix", fix, stamp)
