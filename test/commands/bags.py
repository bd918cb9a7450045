"""Writes bags for the command tests: a short drive with the nodelets' output of it, and copies of a good one
(a raw drive, compressed images, GPS fixes, other sensors)."""

import cmath
import io
import math

import cv2
import numpy as np
import PIL.Image
import rosbag
import rospy
from geometry_msgs.msg import TransformStamped, TwistStamped
from ground_scale_vo.msg import ScaleEstimate
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CompressedImage, Image, Imu, NavSatFix
from std_msgs.msg import Float32, Float64
from tf2_msgs.msg import TFMessage

IMAGE = "/kitti/camera_gray_left/image_rect"
RAW_IMAGE = "/kitti/camera_gray_left/image_raw"
INFO = "/kitti/camera_gray_left/camera_info"
COMPRESSED = "/camera/image_raw/compressed"
SPEED = "/kitti/oxts/gps/vel"


def _set_pose(position, rotation, frame, distance_m, yaw):
    """Forward along z of a camera without rotation, or along x of a base that is turned about z."""
    if frame == "camera":
        position.x, position.y, position.z = 0, 0, distance_m
    else:
        position.x, position.y, position.z = distance_m * math.cos(yaw), distance_m * math.sin(yaw), 0
    rotation.x, rotation.y, rotation.z, rotation.w = 0, 0, math.sin(yaw / 2), math.cos(yaw / 2)


def write_drive(played, recorded, factor=1.0, frame="camera", yaw=0.0, true_yaw=0.0,
                change=lambda topic, message, i: True):
    """A drive of 99 m at 1 m per image, and the nodelets' output of it with a scale that is wrong by
    this factor. change: is called with each message of image i, and returns whether to write it."""
    with rosbag.Bag(str(played), "w") as images, rosbag.Bag(str(recorded), "w") as outputs:
        for i in range(100):
            stamp = rospy.Time(1000 + 0.1 * i)
            image = Image(encoding="mono8", width=1, height=1, step=1, data=b"0")
            image.header.stamp, image.header.frame_id = stamp, "camera"
            truth = TransformStamped(child_frame_id=f"ground_truth/{frame}")
            truth.header.stamp, truth.header.frame_id = stamp, "ground_truth"
            _set_pose(truth.transform.translation, truth.transform.rotation, frame, i, true_yaw)
            scale = ScaleEstimate(status=ScaleEstimate.OK, scale=factor, sigma=0.01 * factor, height=1.65)
            scale.normal.y, scale.header = -1, image.header
            metric, unscaled = Odometry(child_frame_id=frame), Odometry(child_frame_id="camera")
            for odometry, child, distance_m in ((metric, frame, factor * i), (unscaled, "camera", i)):
                odometry.header.stamp, odometry.header.frame_id = stamp, "odom"
                _set_pose(odometry.pose.pose.position, odometry.pose.pose.orientation, child, distance_m,
                          yaw if child == frame else 0.0)
            for bag, topic, message in ((images, "/tf", TFMessage([truth])), (images, IMAGE, image),
                                        (outputs, "/scale", scale), (outputs, "/odometry", metric),
                                        (outputs, "/vo/odometry", unscaled)):
                if change(topic, message, i):
                    bag.write(topic, message, stamp)


def copy(source, file, change):
    """Copies a bag: change(topic, message) returns the topic and message to write, or None."""
    with rosbag.Bag(str(source)) as bag, rosbag.Bag(str(file), "w") as changed:
        for topic, message, stamp in bag.read_messages():
            written = change(topic, message)
            if written:
                changed.write(*written, stamp)


def _raw_layout(topic, message):
    if topic == IMAGE:
        return RAW_IMAGE, message
    if topic == INFO:  # K and D of the raw camera; P of the images
        fx, _, cx, _, _, fy, cy = message.P[:7]
        message.K = [1.4 * fx, 0, cx, 0, 1.4 * fy, cy, 0, 0, 1]
        message.D = [-0.37, 0.2, 0.001, 0.001, -0.07]
        message.distortion_model = "plumb_bob"
    elif topic == "/tf":
        transform = message.transforms[0]
        transform.header.frame_id, transform.child_frame_id = "world", "imu_link"
        # GPS/IMU and camera take turns: the last image has no ground truth.
        transform.header.stamp -= rospy.Duration(0.01)
    return topic, message


def raw_drive(source, file):
    """The bag as kitti2bag writes a raw drive."""
    copy(source, file, _raw_layout)
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


def split(source, folder):
    """The two halves of the bag, as files whose names are difficult for a shell, in a folder of such a name. All
    topics are written without leading slash, the images compressed on camera/jpeg, their calibration only in the
    first half."""
    folder = folder / "it's a drive"
    folder.mkdir()
    compressed, halves = folder / "compressed.bag", [folder / "half 1.bag", folder / "my half's 2.bag"]
    compress(source, compressed)
    names = {COMPRESSED: "camera/jpeg", INFO: "camera/camera_info"}
    with rosbag.Bag(str(compressed)) as bag, rosbag.Bag(str(halves[0]), "w") as first, \
            rosbag.Bag(str(halves[1]), "w") as second:
        middle = rospy.Time.from_sec((bag.get_start_time() + bag.get_end_time()) / 2)
        for topic, message, stamp in bag.read_messages():
            if stamp < middle or topic != INFO:
                (first if stamp < middle else second).write(names.get(topic, topic.lstrip("/")), message, stamp)
    return halves


def speed_of(kind, factor):
    """A message with the speed [m/s] times the factor."""
    def make(stamp, speed):
        if kind in (Float32, Float64):
            return kind(factor * speed)
        message = kind()
        message.header.stamp = stamp
        twist = message.twist if kind is TwistStamped else message.twist.twist
        twist.linear.x = factor * speed
        return message
    return make


def add_speed(source, file, message=speed_of(TwistStamped, 1)):
    """The bag with the speed of its ground truth."""
    copy(source, file, lambda *written: written)
    with rosbag.Bag(str(file), "a") as played:
        truth = [message.transforms[0] for _, message, _ in played.read_messages(["/tf"])]
        positions = [[getattr(transform.transform.translation, axis) for axis in "xyz"] for transform in truth]
        stamps = [transform.header.stamp for transform in truth]
        velocities = np.gradient(positions, [stamp.to_sec() for stamp in stamps], axis=0)
        for stamp, speed in zip(stamps, np.linalg.norm(velocities, axis=1)):
            played.write(SPEED, message(stamp, speed), stamp)


def add_fixes(bag_file, poses):
    """Adds an exact GPS fix (/fix, sigma 0.02 m) for each image. poses: N x 3 x 4."""
    with rosbag.Bag(str(bag_file)) as bag:
        stamps = [message.header.stamp for _, message, _ in bag.read_messages(topics=[IMAGE])]
    turn = cmath.rect(1, math.radians(30))  # the heading; east is real, north imaginary
    with rosbag.Bag(str(bag_file), "a") as bag:
        for stamp, (right, down, forward) in zip(stamps, poses[:, :, 3]):
            place = complex(forward, -right) * turn
            fix = NavSatFix(altitude=110.0 - down)
            fix.header.stamp = stamp
            # Metres of one degree there, 110 m above the ellipsoid (WGS 84).
            fix.latitude, fix.longitude = 49.0 + place.imag / 111211.7, 8.0 + place.real / 73173.1
            fix.position_covariance = [0.0004, 0, 0, 0, 0.0004, 0, 0, 0, 0.0016]
            fix.position_covariance_type = NavSatFix.COVARIANCE_TYPE_DIAGONAL_KNOWN
            bag.write("/fix", fix, stamp)


def add_motion_sensors(bag_file, poses):
    """Adds the mounting base_link -> camera, 1.65 m high on /tf_static, an IMU of 100 Hz with a bias of 0.002 rad/s in
    each axis (/imu/data) and wheels of 50 Hz that read 1 % too much (/wheel/odometry). poses: N x 3 x 4, camera."""
    optical = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # camera axes in the base
    with rosbag.Bag(str(bag_file)) as bag:
        headers = [message.header for _, message, _ in bag.read_messages(topics=[IMAGE])]
    random = np.random.default_rng(1)
    with rosbag.Bag(str(bag_file), "a") as bag:
        mounting = TransformStamped(child_frame_id=headers[0].frame_id)
        mounting.header.frame_id = "base_link"
        mounting.transform.translation.z = 1.65
        rotation = mounting.transform.rotation
        rotation.x, rotation.y, rotation.z, rotation.w = -0.5, 0.5, -0.5, 0.5
        bag.write("/tf_static", TFMessage([mounting]), headers[0].stamp)
        for then, now, before, after in zip(headers, headers[1:], poses, poses[1:]):
            duration = (now.stamp - then.stamp).to_sec()
            turn = before[:, :3].T @ after[:, :3]
            rates = optical @ cv2.Rodrigues(turn)[0].ravel() / duration
            speed = np.linalg.norm(after[:, 3] - before[:, 3]) / duration
            for k in range(10):
                imu = Imu()
                imu.header.frame_id = "base_link"
                imu.header.stamp = then.stamp + rospy.Duration(duration * (k + 1) / 10)
                rate = imu.angular_velocity
                rate.x, rate.y, rate.z = rates + 0.002 + random.normal(0, 0.001, 3)
                imu.angular_velocity_covariance = [5e-6, 0, 0, 0, 5e-6, 0, 0, 0, 5e-6]
                imu.orientation_covariance[0] = -1  # none
                bag.write("/imu/data", imu, imu.header.stamp)
                if k % 2:
                    wheels = Odometry(header=imu.header, child_frame_id="base_link")
                    wheels.twist.twist.linear.x = 1.01 * speed + random.normal(0, 0.02)
                    wheels.twist.covariance[0] = wheels.twist.covariance[7] = 0.01
                    bag.write("/wheel/odometry", wheels, imu.header.stamp)
