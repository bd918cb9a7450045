"""Each launch file resolves to nodes for the arguments in CALLS."""

import pytest
from conftest import ROOT, run

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
another_vo.launch height_file:=HEIGHT image:=
""".strip().splitlines()


@pytest.fixture
def height_file(tmp_path):
    file = tmp_path / "height.yaml"
    file.write_text("camera_height: 1.2345\n")
    return file


@pytest.mark.parametrize("call", CALLS)
def test_resolves_to_nodes(call, height_file, tmp_path):
    driver = tmp_path / "driver.launch"
    driver.write_text('<launch><node pkg="p" type="t" name="n"/></launch>')
    file, *arguments = call.replace("HEIGHT", str(height_file)).replace("DRIVER", str(driver)).split()
    assert run("roslaunch", "--nodes", LAUNCH / file, *arguments).stdout.strip()


def test_all_files_are_covered():
    assert {call.split()[0] for call in CALLS} == {file.name for file in LAUNCH.glob("*.launch")}


@pytest.mark.parametrize("call", ["ground_scale_vo.launch camera_height:=1.65",
                                  "kitti.launch bag:=x.bag"])
def test_height_file_takes_precedence(call, height_file):
    file, *arguments = call.split()
    parameters = run("roslaunch", "--dump-params", LAUNCH / file, *arguments,
                     f"height_file:={height_file}").stdout
    assert "/scale_recovery/camera_height: 1.2345" in parameters.splitlines()
