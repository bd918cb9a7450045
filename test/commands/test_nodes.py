"""The Python nodes that the launch files start."""

import fcntl
import importlib.machinery
import importlib.util
import math
import os
import re
import signal
import socket
import subprocess
import threading
import xmlrpc.client

import bags
import pytest
import rosbag
import rospy
from conftest import ROOT, TIMEOUT_S, assert_refused
from geometry_msgs.msg import Point32, Quaternion
from nav_msgs.msg import Odometry
from sensor_msgs.msg import ChannelFloat32

MODULE_OF_ROS = re.compile(rb"\| +(gen(msg|py)|ros\w+|yaml|numpy)\b")  # or of its dependencies


@pytest.mark.parametrize("node", ["playback_monitor", "view_frame", "feed_another_vo", "bag_recorder"])
def test_interrupt_during_the_imports_ends_silently(node):
    """roslaunch interrupts a node that has just been started when a required one ends."""
    reader, writer = os.pipe()
    # The node blocks in a write while it imports, because the pipe is small and nobody reads it.
    fcntl.fcntl(writer, fcntl.F_SETPIPE_SZ, 4096)
    with subprocess.Popen(["/usr/bin/python3", "-X", "importtime", ROOT / "nodes" / node],
                          stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=writer) as process:
        os.close(writer)
        with open(reader, "rb", buffering=0) as stderr:
            line = b""
            while not MODULE_OF_ROS.search(line):
                line = stderr.readline()
                assert line, "no module of ROS is imported"
            process.send_signal(signal.SIGINT)
            output = stderr.read().decode()
        assert process.wait(TIMEOUT_S) == -signal.SIGINT
    assert "Traceback" not in output, output


@pytest.mark.parametrize("node", ["playback_monitor", "view_frame", "feed_another_vo"])
def test_interrupt_during_the_registration_ends_silently(node, tmp_path):
    with socket.create_server(("localhost", 0)) as master:
        environment = {**os.environ, "ROS_LOG_DIR": str(tmp_path),
                       "ROS_MASTER_URI": f"http://localhost:{master.getsockname()[1]}"}
        process = subprocess.Popen(["/usr/bin/python3", ROOT / "nodes" / node], env=environment,
                                   stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                   stderr=subprocess.STDOUT, text=True)
        try:
            master.settimeout(TIMEOUT_S)
            connection, _ = master.accept()  # by rospy.init_node, which waits for the answer
            process.send_signal(signal.SIGINT)
            connection.close()
            master.close()
            output, _ = process.communicate(timeout=TIMEOUT_S)
        finally:
            process.kill()
    assert process.returncode == -signal.SIGINT and not output, output


@pytest.fixture
def node(request):
    """A node as a module."""
    handler = signal.getsignal(signal.SIGINT)
    loader = importlib.machinery.SourceFileLoader(request.param, str(ROOT / "nodes" / request.param))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader(request.param, loader))
    loader.exec_module(module)
    signal.signal(signal.SIGINT, handler)  # the node has set its own
    return module


def product(a, b):
    """Of two quaternions."""
    return Quaternion(a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y, a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
                      a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w, a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z)


@pytest.mark.parametrize("node", ["view_frame"], indirect=True)
@pytest.mark.parametrize("yaw", [-2.0, 0.0, 0.3, 1.5])
def test_heading_of_the_view(node, yaw):
    """Of a base, and of a camera on it that looks down a little."""
    base = Quaternion(0, 0, math.sin(yaw / 2), math.cos(yaw / 2))
    level = product(base, Quaternion(-0.5, 0.5, -0.5, 0.5))
    camera = product(level, Quaternion(-math.sin(0.1), 0, 0, math.cos(0.1)))
    assert node.heading(base, False) == pytest.approx(yaw)
    assert node.heading(camera, True) == pytest.approx(yaw)


@pytest.mark.parametrize("node", ["view_frame"], indirect=True)
def test_height_of_the_camera_on_a_turned_base(node):
    q = Quaternion(0.5, 0.1, 0.7, 0.5)
    heights = [node.rotated_z(q, node.Vector3(*axis)) for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
    assert heights == pytest.approx([0.6, 0.64, 0.48])


class Viewing:
    """A view_frame without a master, and the transforms that it broadcasts."""

    def __init__(self, node, monkeypatch):
        self.node, self.static, self.moving = node, [], []
        monkeypatch.setattr(node.rospy, "Publisher", lambda *_, **__: self)
        monkeypatch.setattr(node.rospy, "Subscriber", lambda *_, **__: None)
        monkeypatch.setattr(node.tf2_ros, "TransformListener", lambda _: None)
        monkeypatch.setattr(node.tf2_ros, "StaticTransformBroadcaster", lambda: self)
        self.view = node.ViewFrame()

    def publish(self, message):
        self.moving += message.transforms

    def sendTransform(self, transform):
        self.static.append(transform)

    def mount(self, x, y, z):
        """Of the camera on the base."""
        transform = self.node.TransformStamped(child_frame_id="camera")
        transform.header.frame_id = "base_link"
        transform.transform.translation, transform.transform.rotation.w = self.node.Vector3(x, y, z), 1
        self.view._tf.set_transform_static(transform, "test")

    def scale(self, status, scale, height):
        message = self.node.ScaleEstimate(status=status, scale=scale, height=height)
        message.header.frame_id = "camera"
        self.view._on_scale(message)

    def odometry(self, child, position, q):
        message = self.node.Odometry(child_frame_id=child)
        message.header.frame_id = "odom"
        message.pose.pose.position = self.node.Vector3(*position)
        message.pose.pose.orientation = q
        self.view._on_odometry(message)


def placed(transform):
    t, r = transform.transform.translation, transform.transform.rotation
    return (transform.header.frame_id, transform.child_frame_id, (t.x, t.y, t.z), (r.x, r.y, r.z, r.w))


def about_z(yaw):
    return Quaternion(0, 0, math.sin(yaw / 2), math.cos(yaw / 2))


@pytest.mark.parametrize("node", ["view_frame"], indirect=True)
def test_view_of_a_camera_is_on_the_road_and_level(node, monkeypatch):
    viewing = Viewing(node, monkeypatch)
    viewing.scale(node.ScaleEstimate.UNKNOWN, 0, 0)
    forward = Quaternion(-0.5, 0.5, -0.5, 0.5)
    viewing.odometry("camera", (0, 0, 0), forward)
    assert not viewing.moving + viewing.static  # the height is not known
    viewing.scale(node.ScaleEstimate.OK, 0.5, 2.4)
    viewing.odometry("camera", (0, 0, 0), forward)
    viewing.scale(node.ScaleEstimate.HELD, 0.6, 2.0)
    viewing.odometry("camera", (1, 2, 3), product(about_z(0.8), forward))
    assert [placed(transform) for transform in viewing.moving] == [
        ("odom", "ground_scale_vo_view", pytest.approx((0, 0, -1.2)), pytest.approx((0, 0, 0, 1))),
        ("odom", "ground_scale_vo_view", pytest.approx((1, 2, 1.8)),
         pytest.approx((0, 0, math.sin(0.4), math.cos(0.4))))]
    assert [placed(transform) for transform in viewing.static] == [
        ("odom", "ground_scale_vo_road", pytest.approx((0, 0, -1.2)), (0, 0, 0, 1))]


@pytest.mark.parametrize("node", ["view_frame"], indirect=True)
def test_view_of_a_base_is_on_the_road(node, monkeypatch):
    """The nose of the vehicle points up by 0.1 rad, so the camera in front of it is higher."""
    viewing = Viewing(node, monkeypatch)
    viewing.scale(node.ScaleEstimate.OK, 1.0, 1.5)
    pitch = product(about_z(0.8), Quaternion(0, -math.sin(0.05), 0, math.cos(0.05)))
    viewing.odometry("base_link", (1, 2, 3), pitch)
    assert not viewing.moving  # the mounting is not known
    viewing.mount(2, 7, 1.2)
    viewing.odometry("base_link", (1, 2, 3), pitch)
    road_z = 3 + 2 * math.sin(0.1) + 1.2 * math.cos(0.1) - 1.5
    assert placed(viewing.moving[0])[2:] == (pytest.approx((1, 2, road_z)),
                                             pytest.approx((0, 0, math.sin(0.4), math.cos(0.4))))
    assert placed(viewing.static[0])[2] == pytest.approx((0, 0, road_z))


class Feeding:
    """A feed_another_vo without a master, and the frames that it publishes."""

    def __init__(self, node, monkeypatch):
        self.node, self.frames, self.warnings = node, [], []
        publisher = type("Publisher", (), {"publish": lambda _, frame: self.frames.append(frame)})()
        monkeypatch.setattr(node.rospy, "resolve_name", "/cam/{}".format)
        monkeypatch.setattr(node.rospy, "logwarn_throttle", lambda _, text: self.warnings.append(text))
        monkeypatch.setattr(node.rospy, "get_param", lambda name, default: {"~pixel_sigma": 2.0}.get(name, default))
        monkeypatch.setattr(node.rospy, "Publisher", lambda *_, **__: publisher)
        monkeypatch.setattr(node.rospy, "Subscriber", lambda *_, **__: None)
        self.feeder = node.Feeder()

    def camera_info(self):
        self.feeder._on_camera_info(self.node.CameraInfo(
            width=640, height=480, P=[500, 0, 310, 0, 0, 510, 230, 0, 0, 0, 1, 0]))

    def odometry(self, second, x=0):
        message = self.node.Odometry(child_frame_id="camera")
        message.header.stamp.secs = second
        message.pose.pose.position.x, message.pose.pose.orientation.w = x, 1
        self.feeder._on_odometry(message)

    def tracks(self, second, z=10, points=1):
        """One point, ahead of the origin of the map, or none."""
        message = self.node.PointCloud(points=[Point32(0, 0, z)] * points, channels=[
            ChannelFloat32(name, [value] * points) for name, value in (("id", 7), ("u", 320), ("v", 240))])
        message.header.stamp.secs = second
        self.feeder._on_tracks(message)


@pytest.mark.parametrize("node", ["feed_another_vo"], indirect=True)
def test_oldest_messages_without_a_partner_are_dropped(node, monkeypatch):
    feeding = Feeding(node, monkeypatch)
    feeding.camera_info()
    for second in range(1, 42):
        feeding.odometry(second)
    feeding.tracks(41)
    for second in range(42, 83):
        feeding.tracks(second)
    feeding.odometry(82)
    assert [frame.header.stamp.secs for frame in feeding.frames] == [41, 82]
    assert max(len(feeding.feeder._odometry), len(feeding.feeder._tracks)) <= node.MAX_UNPAIRED
    for second in range(101, 131):
        feeding.tracks(second)
    feeding.tracks(1)  # the stamps go back
    feeding.odometry(1)
    assert feeding.frames[-1].header.stamp.secs == 1


@pytest.mark.parametrize("node", ["feed_another_vo"], indirect=True)
def test_frames_of_another_odometry(node, monkeypatch):
    """The camera moves by 1 to the right between two images."""
    feeding = Feeding(node, monkeypatch)
    feeding.camera_info()
    for i in range(3):
        feeding.odometry(i + 1, x=i + 1)
        feeding.tracks(i + 1)
    frames = feeding.frames
    assert [(frame.sequence, frame.id, frame.age) for frame in frames] == [(i, [7], [i]) for i in range(3)]
    assert math.isnan(frames[0].depth_sigma[0])
    assert frames[1].depth_sigma == pytest.approx([10 * 2.0 / (500 * (math.atan(0.2) - math.atan(0.1)))])
    last = frames[2]
    assert (last.width, last.height, last.fx, last.fy, last.cx, last.cy) == (640, 480, 500, 510, 310, 230)
    assert (last.u, last.v, last.x, last.y, last.z) == ([320], [240], [-3], [0], [10])
    assert (last.status, last.header.frame_id, last.pose.position.x) == (node.VoFrame.TRACKING, "camera", 3)
    # Not visible in an image: forgotten.
    for second, points in ((4, 0), (5, 1)):
        feeding.odometry(second)
        feeding.tracks(second, points=points)
    assert [frame.age for frame in frames[3:]] == [[], [0]] and math.isnan(frames[4].depth_sigma[0])


@pytest.mark.parametrize("node", ["feed_another_vo"], indirect=True)
def test_another_odometry_waits_for_camera_info(node, monkeypatch):
    feeding = Feeding(node, monkeypatch)
    feeding.odometry(1)
    feeding.tracks(1)
    assert not feeding.frames and feeding.warnings == ["waiting for /cam/camera_info"] * 2
    feeding.camera_info()
    feeding.odometry(2)
    feeding.tracks(2)
    assert [frame.header.stamp.secs for frame in feeding.frames] == [2] and len(feeding.warnings) == 2


@pytest.mark.parametrize("node", ["feed_another_vo"], indirect=True)
def test_points_behind_the_camera_have_no_depth(node, monkeypatch):
    feeding = Feeding(node, monkeypatch)
    feeding.camera_info()
    for second in (1, 2):
        feeding.odometry(second, x=second)
        feeding.tracks(second, z=-10)
    assert [math.isnan(frame.depth_sigma[0]) for frame in feeding.frames] == [True, True]


@pytest.mark.parametrize("node", ["feed_another_vo"], indirect=True)
def test_points_are_sorted_and_in_camera_axes(node, monkeypatch):
    feeding = Feeding(node, monkeypatch)
    feeding.camera_info()
    odometry = node.Odometry(child_frame_id="camera")
    odometry.header.stamp.secs = 1
    odometry.pose.pose.position = Point32(1, 2, 3)
    odometry.pose.pose.orientation = Quaternion(0.5, 0.1, 0.7, 0.5)
    feeding.feeder._on_odometry(odometry)
    tracks = node.PointCloud(points=[Point32(2, 2, 3), Point32(1, 3, 3), Point32(1, 2, 4)], channels=[
        ChannelFloat32("id", [9, 7, 8]), ChannelFloat32("u", [1, 2, 3]), ChannelFloat32("v", [4, 5, 6])])
    tracks.header.stamp.secs = 1
    feeding.feeder._on_tracks(tracks)
    frame, = feeding.frames
    assert (list(frame.id), list(frame.u), list(frame.v)) == ([7, 8, 9], [2, 3, 1], [5, 6, 4])
    # The axes of the map in those of the camera: y, z, x.
    assert list(zip(frame.x, frame.y, frame.z)) == [
        pytest.approx(axis) for axis in ((0.8, -0.48, -0.36), (0.6, 0.64, 0.48), (0, -0.6, 0.8))]


@pytest.mark.parametrize("node", ["playback_monitor"], indirect=True)
def test_the_bag_ends_with_its_last_image(node, bag):
    with rosbag.Bag(str(bag)) as messages:
        stamps = [message.header.stamp for _, message, _ in messages.read_messages(topics=[bags.IMAGE])]
    summary = node.BagSummary(str(bag), [bags.IMAGE], bags.INFO)
    assert (summary.images, summary.last_image) == (len(stamps), max(stamps))


@pytest.mark.parametrize("node", ["playback_monitor"], indirect=True)
def test_images_that_end_before_the_other_topics(node, bag, tmp_path):
    longer = tmp_path / "longer.bag"
    with rosbag.Bag(str(bag)) as old, rosbag.Bag(str(longer), "w") as new:
        for topic, message, stamp in old.read_messages(topics=[bags.IMAGE, bags.INFO]):
            new.write(topic, message, stamp)
        new.write(bags.INFO, message, stamp + rospy.Duration(20))
    expected = vars(node.BagSummary(str(bag), [bags.IMAGE], bags.INFO))
    summary = vars(node.BagSummary(str(longer), [bags.IMAGE], bags.INFO))
    for name in ("images", "last_image", "last_image_played"):
        assert summary[name] == expected[name]


@pytest.mark.parametrize("node", ["playback_monitor"], indirect=True)
def test_a_damaged_bag_is_refused(node, damaged_bag):
    with pytest.raises(node.PlaybackError, match=re.escape(str(damaged_bag))) as error:
        node.BagSummary(str(damaged_bag), [bags.IMAGE], bags.INFO)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("node", ["playback_monitor"], indirect=True)
@pytest.mark.parametrize("path, images, info, text", [
    ("", [bags.IMAGE], bags.INFO, "bag:=FILE is missing"),
    ("/there/is/none.bag", [bags.IMAGE], bags.INFO, "there is no bag /there/is/none.bag"),
    ("./a/../my.bag", [bags.IMAGE], bags.INFO, "bag:=./a/../my.bag must be an absolute path: bag:=$PWD/my.bag"),
    (None, ["/none", "/neither"], bags.INFO,
     f"has no topic /none or /neither; its topics with images are {bags.IMAGE}"),
    (None, [bags.IMAGE], "/none", f"has no topic /none; its topics with camera_info are {bags.INFO}"),
    (None, [bags.INFO], bags.INFO, "holds sensor_msgs/CameraInfo instead of sensor_msgs/Image"),
])
def test_a_bag_that_cannot_be_played_is_refused(node, bag, path, images, info, text):
    with pytest.raises(node.PlaybackError, match=re.escape(text)):
        node.BagSummary(str(bag) if path is None else path, images, info)


@pytest.mark.parametrize("node", ["playback_monitor"], indirect=True)
def test_two_topics_with_images_are_refused(node, bag, tmp_path):
    """Both would be played on the same topic."""
    both, raw = tmp_path / "both.bag", bags.IMAGE.replace("image_rect", "image_raw")
    with rosbag.Bag(str(bag)) as old, rosbag.Bag(str(both), "w") as new:
        for topic, message, stamp in old.read_messages():
            for name in {topic, topic.replace(bags.IMAGE, raw)}:
                new.write(name, message, stamp)
    with pytest.raises(node.PlaybackError,
                       match=f"has several topics with images, {bags.IMAGE}, {raw}: choose one"):
        node.BagSummary(str(both), [bags.IMAGE, raw], bags.INFO)


@pytest.mark.parametrize("node", ["playback_monitor"], indirect=True)
@pytest.mark.parametrize("rate", ["0", "-1", "inf", "nan", "abc"])
def test_rate_that_is_refused(node, monkeypatch, rate):
    monkeypatch.setattr(node.rospy, "get_param", {"~rate": rate}.get)
    with pytest.raises(node.PlaybackError, match=f"the rate is '{rate}', it must be a positive number"):
        node.playback_rate()


@pytest.mark.parametrize("node", ["playback_monitor"], indirect=True)
def test_distance_of_the_progress(node, monkeypatch):
    monkeypatch.setattr(node.rospy, "Subscriber", lambda *_, **__: type("Subscriber", (), {"resolved_name": ""}))
    output = node.OutputMonitor(3)
    for x, y in ((1, 2), (4, 6), (4, 7)):
        odometry = Odometry()
        odometry.pose.pose.position.x, odometry.pose.pose.position.y = x, y
        output._on_odometry(odometry)
    assert output._distance_m == pytest.approx(6)


@pytest.mark.parametrize("node", ["playback_monitor"], indirect=True)
@pytest.mark.parametrize("answer", [
    b"", b"HTTP/1.1 200 OK\r\nContent-Length: 99\r\n\r\n<?xml version", b"HTTP/1.1 500 error\r\n\r\n", b"none\r\n",
    b"HTTP/1.1 200 OK\r\n\r\n" + xmlrpc.client.dumps(xmlrpc.client.Fault(-1, "unknown method name")).encode()])
def test_a_node_that_ends_while_it_answers_does_not_run(node, answer, monkeypatch):
    """None as for one that has ended: the end of the player is no failure of the monitor."""
    monkeypatch.setattr(node.rospy, "get_name", lambda: "/monitor")
    with socket.create_server(("localhost", 0)) as player:
        def end():
            while True:  # xmlrpc.client asks again when there is no answer
                try:
                    with player.accept()[0] as connection:
                        connection.recv(10000)
                        connection.sendall(answer)
                except OSError:  # closed
                    return

        thread = threading.Thread(target=end)
        thread.start()
        uri = f"http://localhost:{player.getsockname()[1]}"
        try:
            assert node.call(type("Master", (), {"lookupNode": lambda *_: uri})(), "/player", "getPid") is None
        finally:
            player.shutdown(socket.SHUT_RDWR)
            thread.join()


@pytest.mark.parametrize("node", ["playback_monitor"], indirect=True)
def test_a_player_that_cannot_be_resumed_is_named(node, bag, monkeypatch, capsys):
    def unavailable(*_):
        raise node.rospy.ServiceException("service [/bag_player/pause_playback] unavailable")

    for name in ("init_node", "wait_for_service"):
        monkeypatch.setattr(node.rospy, name, lambda *_, **__: None)
    monkeypatch.setattr(node.rospy, "Subscriber", lambda *_, **__: type("Subscriber", (), {"resolved_name": ""}))
    monkeypatch.setattr(node.rospy, "ServiceProxy", lambda *_: unavailable)
    monkeypatch.setattr(node.rospy, "get_param", {
        "~rate": 1, "~bag": str(bag), "~images": [bags.IMAGE], "~camera_info": bags.INFO, "~subscribers": [],
        "~ground_truth": "ground_truth/tf"}.get)
    monkeypatch.setattr(node, "wait_for_graph", lambda _: None)
    monkeypatch.setattr(node.signal, "signal", lambda *_: None)
    assert node.main() == 1
    assert capsys.readouterr().err == "playback_monitor: service [/bag_player/pause_playback] unavailable\n"


@pytest.mark.parametrize("file, text", [
    ("OLD.bag", "OLD.bag exists already; remove it or record to another file"),
    ("my.bag", "record:=my.bag must be an absolute path: record:=$PWD/my.bag")])
def test_bag_recorder_refuses(tmp_path, file, text):
    old = tmp_path / "old"
    old.with_suffix(".bag").write_text("old")
    assert_refused(1, text.replace("OLD", str(old)), ROOT / "nodes/bag_recorder", file.replace("OLD", str(old)))
    assert [path.read_text() for path in tmp_path.iterdir()] == ["old"]
