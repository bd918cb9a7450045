"""Each launch file resolves to nodes for the arguments in CALLS."""

import os
import re
from xml.etree import ElementTree

import conftest
import pytest
import roslaunch.config
import roslaunch.xmlloader
from conftest import ROOT, TIMEOUT_S, run

LAUNCH = ROOT / "launch"
CALLS = """
ground_scale_vo.launch camera_height:=1.2 rviz:=true
ground_scale_vo.launch height_file:=HEIGHT start_manager:=false
kitti.launch bag:=x.bag base_frame:=base_link
kitti.launch bag:=~/x.bag record:=y.bag transport:=compressed
live_camera.launch camera_height:=1.2 driver_launch:=DRIVER
live_camera.launch camera_height:=1.2 driver:=usb_cam calibration:=file:///x mounting:=0,0,1,0,0,0,1
two_vehicles.launch first_height:=1.2 second_height:=1.65
two_vehicles.launch first_height:=1.2 second_height:=1.65 use_base_link:=true
another_vo.launch camera_height:=1.2 image:=camera/image_rect
another_vo.launch camera_height:=1.2 image:=camera/image_rect/compressed
another_vo.launch height_file:=HEIGHT image:=
""".strip().splitlines()


@pytest.fixture
def height_file(tmp_path):
    file = tmp_path / "height.yaml"
    file.write_text("camera_height: 1.2345\n")
    return file


@pytest.fixture
def usb_cam(tmp_path, monkeypatch):
    """A package of this name, which need not be installed."""
    package = tmp_path / "usb_cam"
    package.mkdir()
    (package / "package.xml").write_text("<package><name>usb_cam</name></package>")
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"{package}:{os.environ['ROS_PACKAGE_PATH']}")


@pytest.mark.parametrize("call", CALLS)
def test_resolves_to_nodes(call, height_file, usb_cam, tmp_path):
    driver = tmp_path / "driver.launch"
    driver.write_text('<launch><node pkg="p" type="t" name="n"/></launch>')
    file, *arguments = call.replace("HEIGHT", str(height_file)).replace("DRIVER", str(driver)).split()
    assert run("roslaunch", "--nodes", LAUNCH / file, *arguments).stdout.strip()


@pytest.mark.parametrize("call", CALLS)
def test_parameters_of_an_earlier_launch_are_cleared(call, height_file, usb_cam, tmp_path):
    """A camera_height that an earlier launch has left on the master must not hide a misspelt argument."""
    driver = tmp_path / "driver.launch"
    driver.write_text("<launch/>")
    file, *arguments = call.replace("HEIGHT", str(height_file)).replace("DRIVER", str(driver)).split()
    config = roslaunch.config.ROSLaunchConfig()
    roslaunch.xmlloader.XmlLoader().load(str(LAUNCH / file), config, argv=arguments, verbose=False)
    nodelets = [f"{node.namespace}{node.name}/" for node in config.nodes if "ground_scale_vo/" in node.args]
    assert nodelets and set(nodelets) <= {f"{name.rstrip('/')}/" for name in config.clear_params}


@pytest.mark.parametrize("file", ["ground_scale_vo.launch", "kitti.launch", "live_camera.launch",
                                  "another_vo.launch"])
def test_height_file_in_the_home_folder(file, height_file, monkeypatch):
    """bash does not expand ~ behind :=."""
    monkeypatch.setenv("HOME", str(height_file.parent))
    monkeypatch.setenv("ROS_LOG_DIR", str(height_file.parent / "log"))
    parameters = run("roslaunch", "--dump-params", LAUNCH / file, f"height_file:=~/{height_file.name}").stdout
    assert "/scale_recovery/camera_height: 1.2345" in parameters.splitlines()


def test_a_mounting_that_cannot_be_published_ends_the_launch(tmp_path):
    log = tmp_path / "log"
    with conftest.roslaunch(log, "live_camera.launch", "camera_height:=1.2", "mounting:=1 2 3") as (process, _):
        process.wait(TIMEOUT_S)
    assert "not having the right number of arguments" in log.read_text()


@pytest.mark.parametrize("file", ["ground_scale_vo.launch", "live_camera.launch", "another_vo.launch"])
@pytest.mark.parametrize("mounting", ["", "0,0,1,0,0,0,1"])
def test_base_frame_has_the_same_default_everywhere(file, mounting):
    arguments = [f"mounting:={mounting}"] if file == "live_camera.launch" else []
    parameters = run("roslaunch", "--dump-params", LAUNCH / file, "camera_height:=1.2", *arguments).stdout
    default = "base_link" if mounting and arguments else "''"
    assert f"/scale_recovery/base_frame: {default}" in parameters.splitlines()


@pytest.mark.parametrize("file", ["ground_scale_vo.launch", "live_camera.launch", "kitti.launch"])
def test_mask_reaches_both_nodelets(file):
    def parameters(*arguments):
        bag = ["bag:=x.bag"] if file == "kitti.launch" else []
        return run("roslaunch", "--dump-params", LAUNCH / file, "camera_height:=1.2", *bag,
                   *arguments).stdout.splitlines()
    for nodelet in ("mono_vo", "scale_recovery"):
        assert f"/{nodelet}/mask: /data/hood.png" in parameters("mask:=/data/hood.png")
        assert f"/{nodelet}/mask: ''" in parameters()


@pytest.mark.parametrize("call", ["ground_scale_vo.launch camera_height:=1.2", "kitti.launch bag:=x.bag",
                                  "live_camera.launch camera_height:=1.2"])
def test_rviz_shows_the_odom_frame(call):
    file, *arguments = call.split()
    config = roslaunch.config.ROSLaunchConfig()
    roslaunch.xmlloader.XmlLoader().load(str(LAUNCH / file), config, verbose=False,
                                         argv=[*arguments, "rviz:=true", "odom_frame:=map"])
    rviz, = (node for node in config.nodes if node.package == "rviz")
    assert " -f map" in rviz.args


@pytest.mark.parametrize("argument, text", [
    ("driver:=usb_cam", r"not found[^\n]*usb_cam"),
    ("driver:=realsense", "Invalid <arg> tag: 'driver:=realsense: it must be none or usb_cam'"),
])
def test_missing_camera_driver(argument, text):
    done = run("roslaunch", "--nodes", LAUNCH / "live_camera.launch", "camera_height:=1.2", argument,
               check=False)
    assert done.returncode == 1 and re.search(text, done.stderr), done.stdout + done.stderr


@pytest.mark.parametrize("file", sorted(LAUNCH.glob("*.launch")), ids=lambda file: file.name)
def test_lists_its_arguments(file):
    listed = run("roslaunch", "--ros-args", file).stdout
    names = [arg.get("name") for arg in ElementTree.parse(file).iter("arg") if arg.get("doc")]
    assert names and all(re.search(rf"^  {name}[: ]", listed, re.M) for name in names), listed
    assert "undocumented" not in listed


def test_all_files_are_covered():
    assert {call.split()[0] for call in CALLS} == {file.name for file in LAUNCH.glob("*.launch")}


@pytest.mark.parametrize("call", ["ground_scale_vo.launch camera_height:=1.65",
                                  "kitti.launch bag:=x.bag"])
def test_height_file_takes_precedence(call, height_file):
    file, *arguments = call.split()
    parameters = run("roslaunch", "--dump-params", LAUNCH / file, *arguments,
                     f"height_file:={height_file}").stdout
    assert "/scale_recovery/camera_height: 1.2345" in parameters.splitlines()
