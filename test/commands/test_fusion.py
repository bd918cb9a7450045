"""launch/fused.launch with the real filter, where robot_localization is installed."""

import subprocess

import bags
import numpy as np
import pytest
import rosbag
from conftest import poses_of, rendered, roslaunch, run, tool

PLAY = """<launch>
  <param name="use_sim_time" value="true"/>
  <include file="$(find ground_scale_vo)/launch/fused.launch">
    <arg name="camera_height" value="1.65"/> <arg name="image" value="{image}"/>
    <arg name="image_is_rectified" value="true"/> <arg name="imu" value="{imu}"/> <arg name="wheels" value="{wheels}"/>
  </include>
  <node pkg="rosbag" type="record" name="record" args="-O {out} /odometry /odometry/filtered" required="true"/>
  <node pkg="rosbag" type="play" name="play" args="--clock --quiet --delay 3 --rate 0.5 {bag}" required="true"/>
</launch>"""


@pytest.fixture(scope="module")
def stop(data):
    """A bag of a drive that brakes, stands for two seconds and starts again, with IMU and wheels, and its truth: stamps
    and positions of the base [m]."""
    if subprocess.run(["rospack", "find", "robot_localization"], capture_output=True, check=False).returncode:
        pytest.skip("robot_localization is not installed: the filter is not run")
    folder = rendered(data / "fusion", "--frames", 125, "--size", "640x198")
    bag, poses = folder.with_suffix(".bag"), poses_of(folder / "poses.txt")
    run(tool("kitti_to_bag"), folder, "--out", bag)
    bags.add_motion_sensors(bag, poses)
    with rosbag.Bag(str(bag)) as images:
        stamps = [message.header.stamp.to_sec() for _, message, _ in images.read_messages(topics=[bags.IMAGE])]
    base = poses[:, :, 3] + poses[:, :, 1] * 1.65 - [0, 1.65, 0]  # below the camera
    return bag, np.array(stamps), np.stack([base[:, 2], -base[:, 0], -base[:, 1]], 1)


@pytest.mark.parametrize("imu, wheels", [("", ""), ("/imu/data", "/wheel/odometry")])
def test_the_filter_ends_where_the_odometry_ends(stop, imu, wheels, tmp_path):
    bag, stamps, truth = stop
    out, launch = tmp_path / "out.bag", tmp_path / "play.launch"
    launch.write_text(PLAY.format(bag=bag, out=out, image=bags.IMAGE, imu=imu, wheels=wheels))
    with roslaunch(tmp_path / "log", str(launch)) as (process, _):
        process.wait(120)
    tracks = {"/odometry": [], "/odometry/filtered": []}
    with rosbag.Bag(str(out)) as recorded:
        for topic, message, _ in recorded.read_messages():
            position = message.pose.pose.position
            tracks[topic].append((message.header.stamp.to_sec(), position.x, position.y, position.z))
    odometry, filtered = map(np.array, tracks.values())

    def error(track, stamp):
        """At the last message until the stamp."""
        row = track[track[:, 0] <= stamp + 1e-6][-1]
        return np.linalg.norm(row[1:] - [np.interp(row[0], stamps, axis) for axis in truth.T])

    end = odometry[-1, 0]
    assert error(filtered, end) <= 2 * error(odometry, end) + 0.1
    standing = stamps[1:][np.linalg.norm(np.diff(truth, axis=0), axis=1) < 1e-4]
    assert len(standing) > 10
    still = filtered[(filtered[:, 0] > standing[0] + 0.3) & (filtered[:, 0] < standing[-1])]
    assert len(still) > 10 and np.ptp(still[:, 1:], axis=0).max() < 0.05
