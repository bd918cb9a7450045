"""Each launch file resolves to nodes for the arguments in CALLS."""

import os
import re
from xml.etree import ElementTree

import conftest
import pytest
import roslaunch.config
import roslaunch.substitution_args
import roslaunch.xmlloader
import yaml
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
    monkeypatch.setattr(roslaunch.substitution_args, "_rospack", None)  # remembers that path


@pytest.mark.parametrize("call", CALLS)
def test_resolves_to_nodes(call, height_file, usb_cam, tmp_path):
    driver = tmp_path / "driver.launch"
    driver.write_text('<launch><node pkg="p" type="t" name="n"/></launch>')
    file, *arguments = call.replace("HEIGHT", str(height_file)).replace("DRIVER", str(driver)).split()
    assert run("roslaunch", "--nodes", LAUNCH / file, *arguments).stdout.strip()


def loaded(file, *arguments):
    """Of a launch file: its nodes by name, their remappings, and the values of all parameters."""
    config = roslaunch.config.ROSLaunchConfig()
    roslaunch.xmlloader.XmlLoader().load(str(LAUNCH / file), config, argv=list(arguments), verbose=False)
    nodes = {node.namespace + node.name: node for node in config.nodes}
    remappings = {name: {old: new if new.startswith("/") else node.namespace + new for old, new in node.remap_args}
                  for name, node in nodes.items()}
    return nodes, remappings, {name: parameter.value for name, parameter in config.params.items()}


SHARED = ["camera_height:=1.2", "mask:=/m.png", "odom_frame:=map", "base_frame:=base"]


@pytest.mark.parametrize("file, arguments, image, info, transport, is_rectified, publish_tf", [
    ("ground_scale_vo.launch", ["image:=cam/image/compressed", "camera_info:=cam/info", "image_is_rectified:=true",
                                "publish_tf:=false"], "/cam/image", "/cam/info", "compressed", True, False),
    ("ground_scale_vo.launch", [], "/camera/image_raw", "/camera/camera_info", "raw", False, True),
    ("kitti.launch", ["bag:=/x.bag", "image:=cam/image/compressed", "camera_info:=cam/info",
                      "image_is_rectified:=false"], "/cam/image", "/cam/info", "compressed", False, True),
    ("kitti.launch", ["bag:=/x.bag"], "/kitti/camera_gray_left/image_rect", "/kitti/camera_gray_left/camera_info",
     "raw", True, True),
    ("live_camera.launch", ["camera:=cam", "transport:=compressed", "image_is_rectified:=true",
                            "publish_tf:=false"], "/cam/image_raw", "/cam/camera_info", "compressed", True, False),
    ("live_camera.launch", [], "/camera/image_raw", "/camera/camera_info", "raw", False, True),
])
def test_arguments_reach_both_nodelets(file, arguments, image, info, transport, is_rectified, publish_tf):
    nodes, remappings, parameters = loaded(file, *SHARED, *arguments)
    for nodelet in ("/mono_vo", "/scale_recovery"):
        assert remappings[nodelet] == {"image": image, "camera_info": info}
        assert parameters[f"{nodelet}/image_transport"] == transport
        assert parameters[f"{nodelet}/image_is_rectified"] is is_rectified
        assert parameters[f"{nodelet}/mask"] == "/m.png"
        assert nodes[nodelet].args.endswith(" --no-bond")
    assert parameters["/scale_recovery/camera_height"] == 1.2
    assert parameters["/scale_recovery/odom_frame"] == "map"
    assert parameters["/scale_recovery/base_frame"] == "base"
    assert parameters["/scale_recovery/publish_tf"] is publish_tf


@pytest.mark.parametrize("call, count", [
    ("ground_scale_vo.launch camera_height:=1.2", 2), ("kitti.launch bag:=/x.bag", 2),
    ("live_camera.launch camera_height:=1.2", 2), ("another_vo.launch camera_height:=1.2", 1),
    ("two_vehicles.launch first_height:=1.2 second_height:=1.65", 4)])
def test_configuration_of_the_user_reaches_all_nodelets(call, count, tmp_path):
    for nodelet in ("mono_vo", "scale_recovery"):
        (tmp_path / f"{nodelet}.yaml").write_text("queue_size: 77\n")
    nodes, _, parameters = loaded(*call.split(), f"config_dir:={tmp_path}")
    nodelets = [name for name, node in nodes.items() if "ground_scale_vo/" in node.args]
    assert [parameters.get(f"{name}/queue_size") for name in nodelets] == count * [77]


def test_configuration_has_the_default_values():
    """Those of the reference, which another test compares with the code."""
    _, _, parameters = loaded("ground_scale_vo.launch")
    page = (ROOT / "docs/reference/parameters.md").read_text()
    for nodelet, heading in (("mono_vo", "### MonoVo"), ("scale_recovery", "### ScaleRecovery")):
        section = page.split(heading)[1].split("\n#")[0]
        defaults = dict(re.findall(r"^\| `([a-z_/]+)` \|[^|]*\| `([^`]*)` ", section, re.MULTILINE))
        names = re.findall(r"^(\w+):", (ROOT / f"config/{nodelet}.yaml").read_text(), re.MULTILINE)
        assert len(names) >= 3
        for name in names:
            assert parameters[f"/{nodelet}/{name}"] == yaml.safe_load(defaults[name]), name


def test_kitti_launch_plays_the_bag(monkeypatch, tmp_path):
    nodes, remappings, parameters = loaded("kitti.launch", "bag:=/x.bag", "rate:=2.5", "record:=/y.bag",
                                           "required:=true")
    player = nodes["/bag_player"].args
    assert "--clock" in player and "--rate=2.5 " in player and "--bags='/x.bag'" in player
    topics = player.split("--topics ")[1].split()
    prefix = "/kitti/camera_gray_left/"
    assert topics == [prefix + name for name in ("image_rect", "image_raw", "image", "camera_info")] + \
        ["/tf", "/tf_static"]
    assert remappings["/bag_player"] == {
        prefix + "image_raw": prefix + "image_rect", prefix + "image": prefix + "image_rect",
        "/tf": "/ground_truth/tf", "/tf_static": "/ground_truth/tf_static"}
    assert nodes["/bag_recorder"].args == "'/y.bag' --min-space=1k scale odometry vo/odometry /diagnostics"
    assert parameters["/playback_monitor/exit_at_end"] is True and parameters["/playback_monitor/rate"] == "2.5"
    assert parameters["/scale_recovery/camera_height"] == 1.65 and parameters["/use_sim_time"] is True
    monkeypatch.setenv("HOME", str(tmp_path))
    assert f" --bags='{tmp_path}/x.bag' " in loaded("kitti.launch", "bag:=~/x.bag")[0]["/bag_player"].args
    # With a base_frame the mounting is on /tf_static.
    _, remappings, _ = loaded("kitti.launch", "bag:=/x.bag", "base_frame:=base_link")
    assert "/tf_static" not in remappings["/bag_player"]
    assert remappings["/ground_truth_relay"] == {"ground_truth/tf_static": "/tf_static"}


def test_live_camera_starts_driver_and_mounting(usb_cam):
    nodes, _, parameters = loaded(
        "live_camera.launch", "camera_height:=1.2", "driver:=usb_cam", "width:=800", "height:=600", "framerate:=20",
        "device:=/dev/video3", "pixel_format:=mjpeg", "calibration:=file:///c.yaml", "mounting:=1 2 3 0 0 0 1", "camera_frame:=lens",
        "base_frame:=base")
    expected = {"video_device": "/dev/video3", "image_width": 800, "image_height": 600, "framerate": 20,
                "pixel_format": "mjpeg", "camera_name": "camera", "camera_frame_id": "lens", "camera_info_url": "file:///c.yaml", "autofocus": False}
    assert {name: parameters[f"/camera/{name}"] for name in expected} == expected
    assert nodes["/mounting"].args == "1 2 3 0 0 0 1 base lens"
    _, _, parameters = loaded("live_camera.launch", "camera_height:=1.2", "driver:=usb_cam")
    assert "/camera/camera_info_url" not in parameters


def test_live_camera_starts_another_driver_in_the_namespace_of_the_camera(tmp_path):
    driver = tmp_path / "driver.launch"
    driver.write_text('<launch><node pkg="p" type="t" name="n"/></launch>')
    nodes, _, _ = loaded("live_camera.launch", "camera_height:=1.2", "camera:=cam", f"driver_launch:={driver}")
    assert "/cam/n" in nodes


def test_a_running_manager_unloads_the_nodelets_of_a_loader_that_dies():
    nodes, _, _ = loaded("ground_scale_vo.launch", "camera_height:=1.2", "start_manager:=false", "manager:=other")
    for nodelet in ("/mono_vo", "/scale_recovery"):
        assert " other" in nodes[nodelet].args and "--no-bond" not in nodes[nodelet].args


def test_two_vehicles_have_their_own_arguments():
    nodes, remappings, parameters = loaded("two_vehicles.launch", "first:=a", "second:=b", "first_height:=1.2",
                                           "second_height:=1.65", "first_mask:=/a.png", "second_mask:=/b.png",
                                           "use_base_link:=true", "image:=cam/image", "camera_info:=cam/info",
                                           "image_is_rectified:=true")
    for name, height in (("a", 1.2), ("b", 1.65)):
        scale = f"/{name}/scale_recovery"
        assert parameters[f"{scale}/camera_height"] == height
        assert parameters[f"{scale}/odom_frame"] == f"{name}/odom"
        assert parameters[f"{scale}/base_frame"] == f"{name}/base_link"
        assert parameters[f"{scale}/publish_tf"] is True
        for nodelet in (f"/{name}/mono_vo", scale):
            assert parameters[f"{nodelet}/mask"] == f"/{name}.png"
            assert parameters[f"{nodelet}/image_is_rectified"] is True
            assert remappings[nodelet] == {"image": f"/{name}/cam/image", "camera_info": f"/{name}/cam/info"}
            assert nodes[nodelet].args.endswith(" /vehicles_manager --no-bond")


def test_two_vehicles_with_height_files_and_without_tf(height_file, tmp_path):
    other = tmp_path / "other.yaml"
    other.write_text("camera_height: 2.5\n")
    _, _, parameters = loaded("two_vehicles.launch", f"first_height_file:={height_file}",
                              f"second_height_file:={other}", "publish_tf:=false")
    for name, height in (("first", 1.2345), ("second", 2.5)):
        assert parameters[f"/{name}/scale_recovery/camera_height"] == height
        assert parameters[f"/{name}/scale_recovery/publish_tf"] is False


@pytest.mark.parametrize("image, remapped, transport", [
    ("cam/image", "/cam/image", "raw"), ("cam/image/compressed", "/cam/image", "compressed"), ("", None, "raw")])
def test_arguments_of_another_vo(image, remapped, transport):
    _, remappings, parameters = loaded(
        "another_vo.launch", "camera_height:=1.2", "odometry:=orb/odometry", "tracks:=orb/tracks",
        f"image:={image}", "camera_info:=cam/info", "mask:=/m.png", "odom_frame:=map",
        "base_frame:=base", "publish_tf:=false")
    assert remappings["/feed_another_vo"] == {"odometry_up_to_scale": "/orb/odometry", "tracks": "/orb/tracks",
                                              "camera_info": "/cam/info"}
    assert remappings["/scale_recovery"] == {"camera_info": "/cam/info", **({"image": remapped} if image else {})}
    expected = {"camera_height": 1.2, "refine": bool(image), "image_is_rectified": True, "mask": "/m.png",
                "odom_frame": "map", "base_frame": "base", "publish_tf": False, "image_transport": transport}
    assert {name: parameters[f"/scale_recovery/{name}"] for name in expected} == expected


@pytest.mark.parametrize("call", [call for call in CALLS if not call.startswith("live_camera.launch")])
def test_the_end_of_a_program_ends_the_launch(call, height_file):
    """So a nodelet that refuses its parameters, or a bag that cannot be played, is not overlooked."""
    file, *arguments = call.replace("HEIGHT", str(height_file)).split()
    nodes, _, _ = loaded(file, *arguments)
    optional = {name for name, node in nodes.items() if not node.required}
    assert optional <= {"/bag_player", "/ground_truth_relay", "/rviz", "/view_frame"} and len(optional) < len(nodes)


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


@pytest.mark.parametrize("image, height", [("", 1.65), ("/kitti/camera_gray_left/image_raw", 1.65),
                                           ("kitti/a/compressed", 1.65), ("/camera/image_raw", None)])
def test_only_bags_of_kitti_have_a_default_height_and_rectified_images(image, height):
    """A wrong height makes all distances wrong, so the nodelet refuses to load without it."""
    _, _, parameters = loaded("kitti.launch", "bag:=/x.bag", f"image:={image}")
    assert parameters.get("/scale_recovery/camera_height") == height
    for nodelet in ("mono_vo", "scale_recovery"):
        assert parameters[f"/{nodelet}/image_is_rectified"] is (height is not None)


def test_a_mounting_that_cannot_be_published_ends_the_launch(tmp_path):
    log = tmp_path / "log"
    with conftest.roslaunch(log, "live_camera.launch", "camera_height:=1.2", "mounting:=1 2 3") as (process, _):
        process.wait(TIMEOUT_S)
    assert "not having the right number of arguments" in log.read_text()


@pytest.mark.parametrize("file", ["ground_scale_vo.launch", "live_camera.launch", "another_vo.launch"])
@pytest.mark.parametrize("mounting", ["", "0,0,1,0,0,0,1"])
def test_base_frame_has_the_same_default_everywhere(file, mounting):
    arguments = [f"mounting:={mounting}"] if file == "live_camera.launch" else []
    _, _, parameters = loaded(file, "camera_height:=1.2", *arguments)
    assert parameters["/scale_recovery/base_frame"] == ("base_link" if mounting and arguments else "")


@pytest.mark.parametrize("file", ["ground_scale_vo.launch", "live_camera.launch", "kitti.launch"])
def test_without_a_mask_both_nodelets_use_whole_images(file):
    _, _, parameters = loaded(file, "camera_height:=1.2", *["bag:=/x.bag"] * (file == "kitti.launch"))
    assert [parameters[f"/{nodelet}/mask"] for nodelet in ("mono_vo", "scale_recovery")] == ["", ""]


@pytest.mark.parametrize("call", ["ground_scale_vo.launch camera_height:=1.2", "kitti.launch bag:=x.bag",
                                  "live_camera.launch camera_height:=1.2"])
@pytest.mark.parametrize("odom_frame", ["map", "/map"])
def test_rviz_shows_the_odom_frame(call, odom_frame):
    """tf2 has no leading slash."""
    file, *arguments = call.split()
    config = roslaunch.config.ROSLaunchConfig()
    roslaunch.xmlloader.XmlLoader().load(str(LAUNCH / file), config, verbose=False,
                                         argv=[*arguments, "rviz:=true", f"odom_frame:={odom_frame}"])
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
