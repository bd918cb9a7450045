"""Writes bags for the command tests: damaged ones, a short drive with the nodelets' output of it, and
copies of a good one (one camera_info, layouts of kitti2bag, compressed images, GPS fixes)."""

import io
import math
import random

import PIL.Image
import rosbag
import rospy
from geometry_msgs.msg import TransformStamped
from ground_scale_vo.msg import ScaleEstimate
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CompressedImage, Image, NavSatFix
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

IMAGE = "/kitti/camera_gray_left/image_rect"
INFO = "/kitti/camera_gray_left/camera_info"

COMPRESSED = "/camera/image_raw/compressed"

LATITUDE_DEG, LONGITUDE_DEG = 49.0, 8.0
NORTH_M, EAST_M = 111211.7, 73173.1  # of one degree there, 110 m above the ellipsoid (WGS 84)


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


def _pose(message, forward_m):
    """Forward along z of the camera, without rotation."""
    message.pose.pose.position.z = forward_m
    message.pose.pose.orientation.w = 1
    return message


def write_drive(played, recorded, factor):
    """A drive of 99 m at 1 m per image, and the nodelets' output of it with a scale that is wrong by
    this factor."""
    with rosbag.Bag(str(played), "w") as images, rosbag.Bag(str(recorded), "w") as outputs:
        for i in range(100):
            stamp = rospy.Time(1000 + 0.1 * i)
            image = Image(encoding="mono8", width=1, height=1, step=1, data=b"0")
            image.header.stamp, image.header.frame_id = stamp, "camera"
            truth = TransformStamped(child_frame_id="ground_truth/camera")
            truth.header.stamp, truth.header.frame_id = stamp, "ground_truth"
            truth.transform.translation.z, truth.transform.rotation.w = i, 1
            images.write("/tf", TFMessage([truth]), stamp)
            images.write(IMAGE, image, stamp)
            scale = ScaleEstimate(status=ScaleEstimate.OK, scale=factor, sigma=0.01 * factor, height=1.65)
            scale.normal.y, scale.header = -1, image.header
            outputs.write("/scale", scale, stamp)
            for topic, forward_m in (("/odometry", factor * i), ("/vo/odometry", i)):
                odometry = _pose(Odometry(child_frame_id="camera"), forward_m)
                odometry.header.stamp, odometry.header.frame_id = stamp, "odom"
                outputs.write(topic, odometry, stamp)


# name -> function(a good bag, the file to write)
DAMAGED = {
    "empty_file": _empty_file,
    "truncated": _truncated,
    "no_index": _no_index,
    "noise": _noise,
    "no_messages": _no_messages,
    "text_topic": _text_topic,
}


def copy(source, file, change):
    """Copies a bag: change(topic, message) returns the topic and message to write, or None."""
    with rosbag.Bag(str(source)) as bag, rosbag.Bag(str(file), "w") as changed:
        for topic, message, stamp in bag.read_messages():
            written = change(topic, message)
            if written:
                changed.write(*written, stamp)


def with_one_camera_info(source, file):
    """The bag with only its first camera_info."""
    infos = []

    def change(topic, message):
        if topic != INFO:
            return topic, message
        infos.append(message)
        return (topic, message) if len(infos) == 1 else None

    copy(source, file, change)


def _odometry_layout(image, parent, child):
    def change(topic, message):
        if topic == IMAGE:
            return image, message
        if topic == "/tf":
            message.transforms[0].header.frame_id = parent
            message.transforms[0].child_frame_id = child
        return topic, message

    return change


def _raw_layout(topic, message):
    if topic == IMAGE:
        return "/kitti/camera_gray_left/image_raw", message
    if topic == INFO:  # of the raw camera; P is that of the images
        message.K = [1.4 * value for value in message.P[:3] + message.P[4:7]] + [0, 0, 1]
        message.D = [-0.37, 0.2, 0.001, 0.001, -0.07]
        message.distortion_model = "plumb_bob"
    elif topic == "/tf":
        transform = message.transforms[0]
        transform.header.frame_id, transform.child_frame_id = "world", "imu_link"
        # GPS/IMU and camera take turns: the last image has no ground truth.
        transform.header.stamp -= rospy.Duration(0.01)
    return topic, message


# Layout of kitti2bag -> function(topic, message) that changes a message of kitti_to_bag to it.
LAYOUTS = {
    "odometry": _odometry_layout("/kitti/camera_gray_left/image_rect", "world", "camera_left"),
    "raw": _raw_layout,
    "older": _odometry_layout("/kitti/camera_gray_left/image", "camera_init", "camera_gray_left"),
}


def kitti2bag(layout, source, file):
    copy(source, file, LAYOUTS[layout])
    if layout != "raw":
        return
    with rosbag.Bag(str(file), "a") as bag:
        mounting = TransformStamped()
        mounting.header.frame_id, mounting.child_frame_id = "imu_link", "camera_gray_left"
        mounting.transform.rotation.w = 1
        bag.write("/tf_static", TFMessage([mounting]), rospy.Time.from_sec(bag.get_start_time()))


def compress(source, file):
    """The bag with colour JPEG images on COMPRESSED only."""
    def change(topic, message):
        if topic != IMAGE:
            return topic, message
        compressed = CompressedImage(header=message.header, format="rgb8; jpeg compressed bgr8")
        grey = PIL.Image.frombytes("L", (message.width, message.height), message.data)
        buffer = io.BytesIO()
        grey.convert("RGB").save(buffer, "JPEG", quality=95)
        compressed.data = buffer.getvalue()
        return COMPRESSED, compressed

    copy(source, file, change)


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
