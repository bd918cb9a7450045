"""add_fixes.py BAG POSES: adds a GPS fix (/fix) for each image of a bag, from KITTI poses.

For tests: exact fixes near 49 deg north, 8 deg east, each with a sigma of 0.02 m.
"""

import math
import sys

import rosbag
from sensor_msgs.msg import NavSatFix

LATITUDE, LONGITUDE = 49.0, 8.0
NORTH_M, EAST_M = 111200.5, 73172.0  # of one degree there (WGS84)
IMAGE = "/kitti/camera_gray_left/image"


def main(bag_file, poses_file):
    with open(poses_file, encoding="ascii") as lines:
        poses = [[float(word) for word in line.split()] for line in lines]
    with rosbag.Bag(bag_file) as bag:
        stamps = [message.header.stamp for _, message, _ in bag.read_messages(topics=[IMAGE])]
    turn = math.radians(30)
    with rosbag.Bag(bag_file, "a") as bag:
        for stamp, pose in zip(stamps, poses):
            right, down, ahead = pose[3], pose[7], pose[11]
            fix = NavSatFix()
            fix.header.stamp = stamp
            east = ahead * math.cos(turn) + right * math.sin(turn)
            north = ahead * math.sin(turn) - right * math.cos(turn)
            fix.latitude = LATITUDE + north / NORTH_M
            fix.longitude = LONGITUDE + east / EAST_M
            fix.altitude = 110.0 - down
            fix.position_covariance = [0.0004, 0, 0, 0, 0.0004, 0, 0, 0, 0.0016]
            fix.position_covariance_type = NavSatFix.COVARIANCE_TYPE_DIAGONAL_KNOWN
            bag.write("/fix", fix, stamp)


if __name__ == "__main__":
    main(*sys.argv[1:])
