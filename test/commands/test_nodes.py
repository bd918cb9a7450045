"""The Python nodes that the launch files start."""

import importlib.machinery
import importlib.util
import math
import re
import signal

import bags
import cv2
import numpy as np
import pytest
import rosbag
import rospy
from conftest import ROOT
from diagnostic_msgs.msg import KeyValue
from geometry_msgs.msg import Point32, Quaternion
from sensor_msgs.msg import ChannelFloat32


class Topics:
    """Stands for the publishers and subscribers of a node: keeps what it publishes."""

    def __init__(self, monkeypatch, rospy_of_node):
        self.published, self.resolved_name = [], ""
        for name in ("Publisher", "Subscriber"):
            monkeypatch.setattr(rospy_of_node, name, lambda *_, **__: self)
        monkeypatch.setattr(rospy_of_node, "logwarn_throttle", lambda *_: None)

    def publish(self, message):
        self.published.append(message)


def node(name, monkeypatch):
    """A node as a module, with Topics."""
    handler = signal.getsignal(signal.SIGINT)
    loader = importlib.machinery.SourceFileLoader(name, str(ROOT / "nodes" / name))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader(name, loader))
    loader.exec_module(module)
    signal.signal(signal.SIGINT, handler)  # the node has set its own
    return module, Topics(monkeypatch, module.rospy)


@pytest.fixture
def monitor(monkeypatch):
    return node("playback_monitor", monkeypatch)[0]


def rotation(yaw=0.0, pitch=0.0, roll=0.0):
    """The axes of a body with x forward, z up; pitch > 0 is down."""
    z, y, x = (cv2.Rodrigues(angle * axis)[0] for angle, axis in zip((yaw, pitch, roll), np.eye(3)[::-1]))
    return z @ y @ x


CAMERA = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # axes of a camera that looks along x


@pytest.mark.parametrize("yaw", [-2.0, 0.3, 1.5])
def test_view_is_on_the_road_and_level(monkeypatch, yaw):
    """The vehicle is turned about all axes, so the road is not below the base by the height of the camera. The grid
    of the road stays where the view starts."""
    module, topics = node("view_frame", monkeypatch)
    assert f"Target Frame: {module.VIEW_FRAME}\n" in (ROOT / "rviz/ground_scale_vo.rviz").read_text()
    for name in ("TransformListener", "StaticTransformBroadcaster"):
        monkeypatch.setattr(module.tf2_ros, name, lambda *_: topics)
    monkeypatch.setattr(topics, "sendTransform", topics.publish, raising=False)
    view, estimate = module.ViewFrame(), module.ScaleEstimate

    def scale(status, scale, height):
        message = estimate(status=status, scale=scale, height=height)
        message.header.frame_id = "camera"
        view._on_scale(message)

    def odometry(child, position, axes):
        """axes: the x, y and z axis of the child, in the columns of a matrix. Returns what is published then."""
        message = module.Odometry(child_frame_id=child)
        message.header.frame_id = "odom"
        message.pose.pose.position = module.Vector3(*position)
        w = math.sqrt(1 + np.trace(axes)) / 2
        xyz = (axes[[2, 0, 1], [1, 2, 0]] - axes[[1, 2, 0], [2, 0, 1]]) / (4 * w)
        message.pose.pose.orientation = Quaternion(*xyz, w)
        topics.published.clear()
        view._on_odometry(message)
        return [placed(getattr(sent, "transforms", [sent])[0]) for sent in topics.published]

    def placed(sent):
        t, r = sent.transform.translation, sent.transform.rotation
        assert sent.header.frame_id == "odom" and r.x == r.y == 0
        return [sent.child_frame_id[16:], pytest.approx([t.x, t.y, t.z, 2 * math.atan2(r.z, r.w)])]

    scale(estimate.UNKNOWN, 0, 0)
    assert not odometry("camera", (0, 0, 0), CAMERA)
    scale(estimate.OK, 0.5, 2.4)
    assert odometry("camera", (0, 0, 0), CAMERA) == [["road", [0, 0, -1.2, 0]], ["view", [0, 0, -1.2, 0]]]
    scale(estimate.HELD, 0.6, 2.0)
    assert odometry("camera", (1, 2, 3), rotation(yaw, 0.2) @ CAMERA) == [["view", [1, 2, 1.8, yaw]]]

    axes, mounting = rotation(yaw, -0.1, 0.2), (2, 7, 1.2)
    assert not odometry("base_link", (1, 2, 3), axes)  # the mounting is not known
    transform = module.TransformStamped(child_frame_id="camera")
    transform.header.frame_id = "base_link"
    transform.transform.translation, transform.transform.rotation.w = module.Vector3(*mounting), 1
    view._tf.set_transform_static(transform, "test")
    road_z = 3 + (axes @ mounting)[2] - 1.2
    assert odometry("base_link", (1, 2, 3), axes) == [["view", [1, 2, road_z, yaw]]]


class Feeding:
    """A feed_another_vo without a master, and the frames that it publishes."""

    def __init__(self, monkeypatch):
        self.node, topics = node("feed_another_vo", monkeypatch)
        self.frames = topics.published
        monkeypatch.setattr(self.node.rospy, "get_param", {"~pixel_sigma": 2.0}.get)
        self.feeder = self.node.Feeder()

    def camera_info(self):
        self.feeder._on_camera_info(self.node.CameraInfo(
            width=640, height=480, P=[500, 0, 310, 0, 0, 510, 230, 0, 0, 0, 1, 0]))

    def odometry(self, second, x=0.0, y=0.0, z=0.0, q=Quaternion(0, 0, 0, 1)):
        message = self.node.Odometry(child_frame_id="camera")
        message.header.stamp.secs = second
        message.pose.pose.position, message.pose.pose.orientation = Point32(x, y, z), q
        self.feeder._on_odometry(message)

    def tracks(self, second, points=(Point32(0, 0, 10),), ids=(7,)):
        message = self.node.PointCloud(points=points, channels=[
            ChannelFloat32("id", ids), ChannelFloat32("u", [10 * i for i in ids]),
            ChannelFloat32("v", [20 * i for i in ids])])
        message.header.stamp.secs = second
        self.feeder._on_tracks(message)


def test_frames_of_another_odometry(monkeypatch):
    """The camera moves by 1 to the right between two images. Messages without a partner are forgotten."""
    feeding = Feeding(monkeypatch)
    feeding.odometry(1000)
    feeding.tracks(1000)  # before the camera_info
    feeding.camera_info()
    for second in range(100, 200):
        feeding.odometry(second)
    assert len(feeding.feeder._odometry) <= feeding.node.MAX_UNPAIRED
    for i in range(3):
        feeding.odometry(i + 1, x=i + 1)
        feeding.tracks(i + 1)
    frames = feeding.frames
    assert [(frame.sequence, frame.id, frame.age) for frame in frames] == [(i, [7], [i]) for i in range(3)]
    assert math.isnan(frames[0].depth_sigma[0])
    assert frames[1].depth_sigma == pytest.approx([10 * 2.0 / (500 * (math.atan(0.2) - math.atan(0.1)))])
    last = frames[2]
    assert (last.width, last.height, last.fx, last.fy, last.cx, last.cy) == (640, 480, 500, 510, 310, 230)
    assert (last.u, last.v, last.x, last.y, last.z) == ([70], [140], [-3], [0], [10])
    assert (last.status, last.header.frame_id, last.pose.position.x) == (last.TRACKING, "camera", 3)
    # Not visible in an image: forgotten. Behind the camera: without a depth.
    for second, points in ((4, []), (5, [Point32(0, 0, 10)]), (6, [Point32(0, 0, -10)])):
        feeding.odometry(second, x=second)
        feeding.tracks(second, points, [7] * len(points))
    assert [frame.age for frame in frames[3:]] == [[], [0], [1]]
    assert math.isnan(frames[4].depth_sigma[0]) and math.isnan(frames[5].depth_sigma[0])


def test_points_are_sorted_and_in_camera_axes(monkeypatch):
    feeding = Feeding(monkeypatch)
    feeding.camera_info()
    feeding.odometry(1, 1, 2, 3, Quaternion(0.5, 0.1, 0.7, 0.5))
    feeding.tracks(1, [Point32(2, 2, 3), Point32(1, 3, 3), Point32(1, 2, 4)], [9, 7, 8])
    frame, = feeding.frames
    assert (list(frame.id), list(frame.u), list(frame.v)) == ([7, 8, 9], [70, 80, 90], [140, 160, 180])
    # The axes of the map in the axes of the camera: y, z, x.
    assert list(zip(frame.x, frame.y, frame.z)) == [
        pytest.approx(axis) for axis in ((0.8, -0.48, -0.36), (0.6, 0.64, 0.48), (0, -0.6, 0.8))]


def test_a_damaged_bag_is_refused(monitor, damaged_bag):
    with pytest.raises(monitor.PlaybackError, match=re.escape(str(damaged_bag)) + "[^\n]*$"):
        monitor.BagSummary(str(damaged_bag), [bags.IMAGE], bags.INFO)


def test_the_words_of_several_bags(monitor, tmp_path):
    (tmp_path / "it's.bag").touch()
    assert monitor.bag_files(f"{tmp_path}/it's.bag") == [f"{tmp_path}/it's.bag"]
    with pytest.raises(monitor.PlaybackError, match="there is no bag /none/it's.bag$"):
        monitor.bag_files("/none/it's.bag")
    with pytest.raises(monitor.PlaybackError, match=re.escape('bag:="$PWD/a.bag $PWD/b.bag"')):
        monitor.bag_files("./a.bag b.bag")


def test_a_speed_error_that_has_ended_is_no_failure(monitor):
    output = monitor.OutputMonitor(1)
    for error, text in (("speeds of another unit", "speeds of another unit"), ("", "no metric pose: ")):
        status = monitor.DiagnosticStatus(name="/scale_recovery: scale", values=[KeyValue("speed error", error)])
        output._on_diagnostics(monitor.DiagnosticArray(status=[status]))
        with pytest.raises(monitor.PlaybackError, match=text):
            output.summary()


def test_the_bag_ends_with_its_last_image(monitor, bag, tmp_path):
    """Longer topics do not matter."""
    longer = tmp_path / "longer.bag"
    with rosbag.Bag(str(bag)) as old, rosbag.Bag(str(longer), "w") as new:
        for topic, message, stamp in old.read_messages(topics=[bags.IMAGE, bags.INFO]):
            new.write(topic, message, stamp)
        new.write(bags.INFO, message, stamp + rospy.Duration(20))
        images = [message.header.stamp for _, message, _ in old.read_messages(topics=[bags.IMAGE])]
    for file in (bag, longer):
        summary = monitor.BagSummary(str(file), [bags.IMAGE], bags.INFO)
        assert (summary.images, summary.last_image) == (len(images), max(images))


@pytest.mark.parametrize("path, images, info, text", [
    ("", [bags.IMAGE], bags.INFO, "bag:=FILE is missing"),
    ("./a/../my.bag", [bags.IMAGE], bags.INFO, "must be an absolute path: bag:=$PWD/my.bag"),
    (None, ["/none", "/neither"], bags.INFO, "has no topic /none or /neither; its topics with images are /both, "),
    (None, [bags.IMAGE], "/none", f"has no topic /none; its topics with camera_info are {bags.INFO}"),
    (None, [bags.INFO], bags.INFO, "holds sensor_msgs/CameraInfo instead of sensor_msgs/Image"),
    # Both would be played on the same topic.
    (None, [bags.IMAGE, "/both"], bags.INFO, f"has several topics with images, {bags.IMAGE}, /both: choose one with image:=TOPIC"),
])
def test_a_bag_that_cannot_be_played_is_refused(monitor, bag, tmp_path, path, images, info, text):
    two = tmp_path / "two.bag"
    with rosbag.Bag(str(bag)) as old, rosbag.Bag(str(two), "w") as new:
        for topic, message, stamp in old.read_messages():
            for name in {topic, topic.replace(bags.IMAGE, "/both")}:
                new.write(name, message, stamp)
    with pytest.raises(monitor.PlaybackError, match=re.escape(text)):
        monitor.BagSummary(str(two) if path is None else path, images, info)
