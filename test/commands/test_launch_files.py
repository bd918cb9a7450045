"""What the launch files start, for arguments as users give them: nodes, topics, parameters."""

import os
import re

import pytest
import roslaunch.config
import roslaunch.substitution_args
import roslaunch.xmlloader
import yaml
from conftest import ROOT

LAUNCH = ROOT / "launch"
# Each launch file with the least arguments that it needs, and the nodelets that it loads.
FILES = {
    "ground_scale_vo.launch camera_height:=1.2": ["/mono_vo", "/scale_recovery"],
    "bag.launch bag:=/x.bag image:=/cam/image camera_height:=1.2": ["/mono_vo", "/scale_recovery"],
    "kitti.launch bag:=/x.bag": ["/mono_vo", "/scale_recovery"],
    "live_camera.launch camera_height:=1.2": ["/mono_vo", "/scale_recovery"],
    "fused.launch camera_height:=1.2": ["/mono_vo", "/scale_recovery"],
    "another_vo.launch camera_height:=1.2": ["/scale_recovery"],
    "two_vehicles.launch first_height:=1.2 second_height:=1.65": [
        "/first/mono_vo", "/first/scale_recovery", "/second/mono_vo", "/second/scale_recovery"],
}
IMAGE, INFO = "/kitti/camera_gray_left/image_rect", "/kitti/camera_gray_left/camera_info"


def loaded(call, *arguments):
    """Of a launch file: its nodes by name, their remappings, the values of all parameters, and the
    namespaces that it clears first."""
    file, *words = call.split()
    config = roslaunch.config.ROSLaunchConfig()
    roslaunch.xmlloader.XmlLoader().load(str(LAUNCH / file), config, argv=[*words, *arguments], verbose=False)
    nodes = {node.namespace + node.name: node for node in config.nodes}
    remappings = {name: {old: new if new.startswith("/") else node.namespace + new for old, new in node.remap_args}
                  for name, node in nodes.items()}
    parameters = {name: parameter.value for name, parameter in config.params.items()}
    return nodes, remappings, parameters, {name.rstrip("/") for name in config.clear_params}


@pytest.fixture
def height_file(tmp_path, monkeypatch):
    """In the home folder; bash does not expand ~ behind :=."""
    (tmp_path / "height.yaml").write_text("camera_height: 1.2345\n")
    monkeypatch.setenv("HOME", str(tmp_path))
    return "~/height.yaml"


@pytest.mark.parametrize("call", FILES)
def test_nodelets(call, tmp_path):
    """They get the configuration of the user. The end of a program ends the launch, so a nodelet that refuses its
    parameters is not overlooked. A camera_height that an earlier launch has left on the master must not hide a
    misspelt argument."""
    for nodelet in ("mono_vo", "scale_recovery"):
        (tmp_path / f"{nodelet}.yaml").write_text("queue_size: 77\n")
    nodes, _, parameters, cleared = loaded(call, f"config_dir:={tmp_path}")
    assert [name for name, node in nodes.items() if "ground_scale_vo/" in node.args] == FILES[call]
    for nodelet in FILES[call]:
        assert parameters[f"{nodelet}/queue_size"] == 77 and nodelet in cleared
        if nodelet.endswith("mono_vo"):
            assert parameters[f"{nodelet}/mask"] == "" and parameters[f"{nodelet}/camera_file"] == ""
    assert {name for name, node in nodes.items() if not node.required} <= {"/ground_truth_relay"}


@pytest.mark.parametrize("file, arguments, image, info, transport, is_rectified, publish_tf", [
    ("ground_scale_vo.launch", ["image:=cam/image/compressed", "camera_info:=cam/info", "image_is_rectified:=true",
                                "publish_tf:=false"], "/cam/image", "/cam/info", "compressed", True, False),
    ("ground_scale_vo.launch", [], "/camera/image_raw", "/camera/camera_info", "raw", False, True),
    ("ground_scale_vo.launch", ["image:=/cam/image/compressed"], "/cam/image", "/cam/camera_info", "compressed", False,
     True),
    ("bag.launch", ["bag:=/x.bag", "image:=cam/image/compressed", "camera_info:=cam/info",
                    "image_is_rectified:=true"], "/cam/image", "/cam/info", "raw_or_compressed", True, True),
    ("bag.launch", ["bag:=/x.bag", "image:=cam/image", "transport:=theora"], "/cam/image", "/cam/camera_info",
     "theora", False, True),
    ("kitti.launch", ["bag:=/x.bag", "image:=cam/image"], "/cam/image", "/cam/camera_info", "raw_or_compressed",
     False, True),
    ("kitti.launch", ["bag:=/x.bag"], IMAGE, INFO, "raw_or_compressed", True, True),
    ("live_camera.launch", ["camera:=cam", "transport:=compressed", "image_is_rectified:=true",
                            "publish_tf:=false"], "/cam/image_raw", "/cam/camera_info", "compressed", True, False),
    ("live_camera.launch", [], "/camera/image_raw", "/camera/camera_info", "raw", False, True),
])
def test_arguments_reach_the_nodelets(file, arguments, image, info, transport, is_rectified, publish_tf):
    nodes, remappings, parameters, _ = loaded(
        file, "camera_height:=1.2", "mask:=/m.png", "camera_file:=/c.yaml", "odom_frame:=/map", "base_frame:=base",
        "refine_camera:=false", "refined_camera_file:=/r.yaml", "rviz:=true", *arguments)
    assert remappings["/mono_vo"] == {"image": image, "camera_info": info}
    assert remappings["/scale_recovery"] == {"vo/image": "/vo/image"}
    assert parameters["/mono_vo/image_transport"] == transport
    assert parameters["/mono_vo/image_is_rectified"] is is_rectified
    assert parameters["/mono_vo/mask"] == "/m.png" and parameters["/mono_vo/camera_file"] == "/c.yaml"
    assert all(nodes[nodelet].args.endswith(" --no-bond") for nodelet in ("/mono_vo", "/scale_recovery"))
    assert parameters["/mono_vo/refine_camera"] is False and parameters["/mono_vo/refined_camera_file"] == "/r.yaml"
    expected = {"camera_height": 1.2, "odom_frame": "/map", "base_frame": "base", "publish_tf": publish_tf}
    assert {name: parameters[f"/scale_recovery/{name}"] for name in expected} == expected
    assert " -f map" in nodes["/rviz"].args  # tf2 has no leading slash


@pytest.mark.parametrize("file", ["ground_scale_vo.launch camera_height:=1.65", "kitti.launch bag:=/x.bag",
                                  "live_camera.launch", "another_vo.launch"])
def test_height_file_takes_precedence(file, height_file):
    assert loaded(file, f"height_file:={height_file}")[2]["/scale_recovery/camera_height"] == 1.2345


@pytest.mark.parametrize("file", [call.split(" camera_height")[0] for call in FILES if "two_vehicles" not in call])
def test_preset(file, height_file, capfd):
    parameters = loaded(file, "preset:=nuscenes")[2]
    assert parameters["/scale_recovery/camera_height"] == 1.5 and parameters["/scale_recovery/camera_height_sigma"] == 0.015
    for other in ("camera_height:=1.5", f"height_file:={height_file}"):
        with pytest.raises(Exception, match="preset:=nuscenes and another height: give one"):
            loaded(file, "preset:=nuscenes", other)
    with pytest.raises(Exception, match="presets.py"):
        loaded(file, "preset:=trabant")
    assert "there is no preset trabant, only kitti, nuscenes, " in capfd.readouterr().err


def test_presets_are_documented():
    """The table is made of the file; a standard deviation is at least 1 % of the height."""
    rows = ""
    for name, row in yaml.safe_load((ROOT / "config/presets.yaml").read_text()).items():
        assert 0.01 <= row["camera_height_sigma"] / row["camera_height"] <= 0.1
        rows += "| `{}` | {camera_height:g} ± {camera_height_sigma:g} | {source} | {pitfalls} |\n".format(name, **row)
    assert rows in (ROOT / "docs/tutorials/your_camera.md").read_text(), rows


def test_configuration_has_the_documented_defaults():
    _, _, parameters, _ = loaded("ground_scale_vo.launch")
    assert parameters["/scale_recovery/base_frame"] == "" and "/scale_recovery/camera_height" not in parameters
    page = (ROOT / "docs/reference/parameters.md").read_text()
    for nodelet, heading in (("mono_vo", "### MonoVo"), ("scale_recovery", "### ScaleRecovery")):
        section = page.split(heading)[1].split("\n#")[0]
        defaults = dict(re.findall(r"^\| `([a-z_/]+)` \|[^|]*\| `([^`]*)` ", section, re.MULTILINE))
        names = re.findall(r"^(\w+):", (ROOT / f"config/{nodelet}.yaml").read_text(), re.MULTILINE)
        assert len(names) >= 3
        for name in names:
            assert parameters[f"/{nodelet}/{name}"] == yaml.safe_load(defaults[name]), name


@pytest.mark.parametrize("image, height", [("", 1.65), ("/kitti/camera_gray_left/image_raw", 1.65),
                                           ("kitti/a/compressed", 1.65), ("/camera/image_raw", None)])
def test_only_bags_of_kitti_have_a_default_height_and_rectified_images(image, height):
    """A wrong height makes all distances wrong, so the nodelet refuses to load without it."""
    _, _, parameters, _ = loaded("kitti.launch", "bag:=/x.bag", f"image:={image}")
    assert parameters.get("/scale_recovery/camera_height") == height
    assert parameters["/mono_vo/image_is_rectified"] is (height is not None)


def test_live_camera_starts_driver_and_mounting(tmp_path, monkeypatch):
    live_camera, driver = "live_camera.launch camera_height:=1.2", tmp_path / "driver.launch"
    with pytest.raises(Exception, match="realsense"):
        loaded(live_camera, "driver:=realsense")
    (tmp_path / "package.xml").write_text("<package><name>usb_cam</name></package>")
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"{tmp_path}:{os.environ['ROS_PACKAGE_PATH']}")
    monkeypatch.setattr(roslaunch.substitution_args, "_rospack", None)  # remembers that path
    nodes, _, parameters, _ = loaded(
        live_camera, "camera:=/camera", "driver:=usb_cam", "width:=800", "height:=600", "framerate:=20", "device:=/dev/video3",
        "calibration:=file:///c.yaml", "mounting:=1 2 3 0 0 0 1", "camera_frame:=lens")
    expected = {"video_device": "/dev/video3", "image_width": 800, "image_height": 600, "framerate": 20,
                "camera_frame_id": "lens", "camera_info_url": "file:///c.yaml"}
    assert {name: parameters[f"/camera/{name}"] for name in expected} == expected
    assert nodes["/mounting"].args == "1 2 3 0 0 0 1 base_link lens"
    assert parameters["/scale_recovery/base_frame"] == "base_link"
    driver.write_text('<launch><node pkg="p" type="t" name="n"/></launch>')
    nodes, _, parameters, _ = loaded(live_camera, "camera:=cam", f"driver_launch:={driver}")
    assert "/cam/n" in nodes and parameters["/scale_recovery/base_frame"] == ""


def test_two_vehicles(tmp_path, height_file):
    nodes, remappings, parameters, _ = loaded(
        "two_vehicles.launch", "first:=a", "second:=/b", f"first_height_file:={height_file}", "second_preset:=kitti",
        "first_mask:=/a.png", "second_mask:=/b.png", "first_camera_file:=/a.yaml", "second_camera_file:=/b.yaml",
        "use_base_link:=true", "image:=/cam/image", "camera_info:=cam/info", "image_is_rectified:=true",
        "publish_tf:=false")
    for name, height in (("a", 1.2345), ("b", 1.65)):
        scale = f"/{name}/scale_recovery"
        expected = {"camera_height": height, "odom_frame": f"{name}/odom", "base_frame": f"{name}/base_link",
                    "publish_tf": False}
        assert {key: parameters[f"{scale}/{key}"] for key in expected} == expected
        mono_vo = f"/{name}/mono_vo"
        assert parameters[f"{mono_vo}/mask"] == f"/{name}.png"
        assert parameters[f"{mono_vo}/camera_file"] == f"/{name}.yaml"
        assert parameters[f"{mono_vo}/image_is_rectified"] is True
        assert remappings[mono_vo] == {"image": f"/{name}/cam/image", "camera_info": f"/{name}/cam/info"}
        assert remappings[scale] == {"vo/image": f"/{name}/vo/image"}
        assert all(nodes[nodelet].args.endswith(" /vehicles_manager --no-bond") for nodelet in (mono_vo, scale))


def test_respawn():
    """For a manager that is started again elsewhere: the nodelets are loaded again."""
    nodes, *_ = loaded("ground_scale_vo.launch", "camera_height:=1", "start_manager:=false", "respawn:=true")
    for name in ("/mono_vo", "/scale_recovery"):
        assert nodes[name].respawn and not nodes[name].required and not nodes[name].args.endswith("--no-bond")


@pytest.mark.parametrize("image", ["cam/image_rect", ""])
def test_another_vo(image):
    _, remappings, parameters, _ = loaded(
        "another_vo.launch", "camera_height:=1.2", "odometry:=orb/odometry", "tracks:=orb/tracks",
        f"image:={image}", "camera_info:=cam/info", "mask:=/m.png", "odom_frame:=map",
        "base_frame:=base", "publish_tf:=false")
    assert remappings["/feed_another_vo"] == {"odometry_up_to_scale": "/orb/odometry", "tracks": "/orb/tracks",
                                              "camera_info": "/cam/info"}
    assert parameters["/feed_another_vo/mask"] == "/m.png"
    assert remappings["/scale_recovery"] == ({"vo/image": "/cam/image_rect"} if image else {})
    expected = {"camera_height": 1.2, "refine": bool(image), "odom_frame": "map", "base_frame": "base",
                "publish_tf": False}
    assert {name: parameters[f"/scale_recovery/{name}"] for name in expected} == expected


@pytest.mark.parametrize("call", [call for call in FILES if "two_vehicles" not in call])
def test_a_speed_replaces_the_height(call, height_file):
    file, node = call.split()[0], "/scale_recovery"
    is_bag = file in ("bag.launch", "kitti.launch")
    _, remappings, parameters, _ = loaded(file, "speed:=/wheel/odom", f"learned_height_file:={height_file}",
                                          *(["bag:=/x.bag"] if is_bag else []))
    # The speed of a bag is played on `speed`.
    assert remappings[node]["speed"] == ("/speed" if is_bag else "/wheel/odom")
    assert parameters[f"{node}/use_speed"] is True and f"{node}/camera_height" not in parameters
    assert parameters[f"{node}/height_file"] == height_file
    # The height of a file is improved in place. Without a speed nothing is subscribed.
    _, remappings, parameters, _ = loaded(call, f"height_file:={height_file}")
    assert parameters[f"{node}/height_file"] == height_file
    assert parameters[f"{node}/use_speed"] is False and "speed" not in remappings[node]


def test_fused_launch_gives_the_filter_the_sensors_that_exist():
    """Only the filter broadcasts odom -> base_link."""
    call = "fused.launch camera_height:=1.2"
    _, _, parameters, _ = loaded(call)
    assert parameters["/scale_recovery/publish_tf"] is False and parameters["/ekf/publish_tf"] is True
    assert parameters["/scale_recovery/base_frame"] == parameters["/ekf/base_link_frame"] == "base_link"
    assert len(parameters["/ekf/process_noise_covariance"]) == len(parameters["/ekf/initial_estimate_covariance"]) == 225
    assert "/ekf/imu0" not in parameters and "/ekf/odom1" not in parameters
    _, _, parameters, _ = loaded(call, "imu:=/imu", "wheels:=/wheels", "two_d:=true", "odom_frame:=map")
    assert parameters["/ekf/imu0"] == "/imu" and parameters["/ekf/odom1"] == "/wheels"
    assert parameters["/ekf/two_d_mode"] is True and parameters["/ekf/world_frame"] == "map"
