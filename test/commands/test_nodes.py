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

import pytest
from conftest import ROOT, TIMEOUT_S
from geometry_msgs.msg import Point32, Quaternion
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
def test_view_is_at_the_position_and_level(node):
    published = []
    view = node.ViewFrame.__new__(node.ViewFrame)
    view._camera_frame = "camera"
    view._publisher = type("Publisher", (), {"publish": lambda _, message: published.append(message)})()
    odometry = node.Odometry(child_frame_id="base_link")
    odometry.header.frame_id = "odom"
    position, q = odometry.pose.pose.position, odometry.pose.pose.orientation
    position.x, position.y, position.z, q.z, q.w = 1, 2, 3, math.sin(0.4), math.cos(0.4)
    view._on_odometry(odometry)
    transform = published[0].transforms[0]
    t, r = transform.transform.translation, transform.transform.rotation
    assert (transform.header.frame_id, t.x, t.y, t.z) == ("odom", 1, 2, 3)
    assert (r.x, r.y, r.z, r.w) == pytest.approx((0, 0, math.sin(0.4), math.cos(0.4)))


class Feeding:
    """A feed_another_vo without a master, and the frames that it publishes."""

    def __init__(self, node, monkeypatch):
        self.node, self.frames = node, []
        publisher = type("Publisher", (), {"publish": lambda _, frame: self.frames.append(frame)})()
        monkeypatch.setattr(node.rospy, "get_param", lambda name, default: {"~pixel_sigma": 2.0}.get(name, default))
        monkeypatch.setattr(node.rospy, "Publisher", lambda *_, **__: publisher)
        monkeypatch.setattr(node.rospy, "Subscriber", lambda *_, **__: None)
        self.feeder = node.Feeder()
        self.feeder._on_camera_info(node.CameraInfo(
            width=640, height=480, P=[500, 0, 310, 0, 0, 510, 230, 0, 0, 0, 1, 0]))

    def odometry(self, second, x=0):
        message = self.node.Odometry(child_frame_id="camera")
        message.header.stamp.secs = second
        message.pose.pose.position.x, message.pose.pose.orientation.w = x, 1
        self.feeder._on_odometry(message)

    def tracks(self, second):
        """One point, 10 ahead of the origin of the map."""
        message = self.node.PointCloud(points=[Point32(0, 0, 10)], channels=[
            ChannelFloat32(name, [value]) for name, value in (("id", 7), ("u", 320), ("v", 240))])
        message.header.stamp.secs = second
        self.feeder._on_tracks(message)


@pytest.mark.parametrize("node", ["feed_another_vo"], indirect=True)
def test_oldest_messages_without_a_partner_are_dropped(node, monkeypatch):
    feeding = Feeding(node, monkeypatch)
    for second in range(1, 42):
        feeding.odometry(second)
    feeding.tracks(41)
    for second in range(42, 83):
        feeding.tracks(second)
    feeding.odometry(82)
    assert [frame.header.stamp.secs for frame in feeding.frames] == [41, 82]
    assert max(len(feeding.feeder._odometry), len(feeding.feeder._tracks)) <= node.MAX_UNPAIRED


@pytest.mark.parametrize("node", ["feed_another_vo"], indirect=True)
def test_frames_of_another_odometry(node, monkeypatch):
    """The camera moves by 1 to the right between two images."""
    feeding = Feeding(node, monkeypatch)
    for i in range(3):
        feeding.odometry(i + 1, x=i)
        feeding.tracks(i + 1)
    frames = feeding.frames
    assert [(frame.sequence, frame.id, frame.age) for frame in frames] == [(i, [7], [i]) for i in range(3)]
    assert math.isnan(frames[0].depth_sigma[0])
    assert frames[1].depth_sigma == pytest.approx([10 * 2.0 / (500 * math.atan(0.1))])
    last = frames[2]
    assert (last.width, last.height, last.fx, last.fy, last.cx, last.cy) == (640, 480, 500, 510, 310, 230)
    assert (last.u, last.v, last.x, last.y, last.z) == ([320], [240], [-2], [0], [10])
    assert (last.status, last.header.frame_id, last.pose.position.x) == (node.VoFrame.TRACKING, "camera", 2)
