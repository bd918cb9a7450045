"""Every door gives the same metres, or refuses: the inputs of users through the command `ground_scale_vo run`, the
Python module, run_sequence and, for bags, kitti.launch. A new kind of input is a row of CASES."""

import itertools
import re
import shutil
from typing import Any, Callable, NamedTuple, Optional

import bags
import cv2
import genpy.dynamic
import numpy as np
import pytest
import rosbag
import rospy
from bags import IMAGE, INFO, SPEED, speed_of
from conftest import (CAMERA_HEIGHT, FRAMES, ROOT, TIMEOUT_S, camera_matrix, images_of, roslaunch, run, tool, wait_until,
                      write_camera)
from geometry_msgs.msg import TwistStamped, TwistWithCovarianceStamped
from ground_scale_vo.msg import ScaleEstimate
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, RegionOfInterest
from std_msgs.msg import Float32, Float64


class Case(NamedTuple):
    """make(short, path): writes the input, of which path is a free name without extension, and returns its path.
    options: of the commands; the word CAMERA stands for a calibration file.
    refusal: what every door says (a regular expression), with exit status 1; None: all give the same path.
    tolerance: of the path's length compared to the plain drive; doors: of two doors [shares]. launch: arguments of
    kitti.launch. python: what the Python module, which knows one camera, says in place of a path.
    first: the image of the plain drive with which it begins."""

    make: Callable[[Any, Any], Any]
    options: tuple = ("--camera", "CAMERA")
    refusal: Optional[str] = None
    tolerance: float = 0.003
    launch: tuple = ()
    doors: float = 0.003
    python: Optional[str] = None
    first: int = 0


def folder(name=lambda i: f"frame{i:06}.png", change=lambda image: image, times="{:.6f}".format, images=FRAMES):
    """A folder of images at 10 Hz; times: of an image's time [s] (None: no times.txt), or the whole text."""
    def make(short, path):
        path.mkdir()
        for i, image in enumerate(images_of(short)[:images]):
            cv2.imwrite(str(path / name(i)), change(image))
        if times:
            text = times if isinstance(times, str) else "".join(times(i / 10) + "\n" for i in range(images))
            (path / "times.txt").write_bytes(text.encode())
        return path
    return make


def video(**parts):
    """A video without loss; parts: share of the file that is kept."""
    def make(short, path):
        file = path.with_suffix(".avi")
        images = images_of(short)
        writer = cv2.VideoWriter(str(file), cv2.VideoWriter_fourcc(*"FFV1"), 10, images[0].shape[::-1])
        for image in images:
            writer.write(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
        writer.release()
        if parts:
            file.write_bytes(file.read_bytes()[:int(parts["share"] * file.stat().st_size)])
        return file
    return make


def cut_video(short, path):
    """An MP4 whose edit list hides the first second, as after cutting without encoding."""
    whole, cut = path.with_suffix(".mov"), path.with_suffix(".mp4")
    run("ffmpeg", "-v", "error", "-framerate", 10, "-i", short / "image_0/%06d.png", "-c:v", "libx264", "-qp", 0, "-g", 200,
        whole)
    run("ffmpeg", "-v", "error", "-ss", 1, "-i", whole, "-c", "copy", cut)
    return cut


def euroc(short, path):
    """mav0/cam0 of EuRoC."""
    folder(lambda i: f"{1403636579763555584 + i * 10**8}.png", times=None)(short, path)
    path.rename(path.with_name("data"))
    path.mkdir()
    path.with_name("data").rename(path / "data")
    lines = [f"{file.stem},{file.name}" for file in sorted((path / "data").iterdir())]
    (path / "data.csv").write_text("\n".join(["#timestamp [ns],filename", *lines, ""]))
    height, width = images_of(short)[0].shape
    (fx, _, cx), (_, fy, cy), _ = camera_matrix(short).tolist()
    (path / "sensor.yaml").write_text(f"""sensor_type: camera
rate_hz: 10
resolution: [{width}, {height}]
camera_model: pinhole
intrinsics: [{fx}, {fy}, {cx}, {cy}]
distortion_model: radial-tangential
distortion_coefficients: [0, 0, 0, 0]
""")
    return path


def around_mav0(short, path):
    (path / "mav0").mkdir(parents=True)
    euroc(short, path / "mav0/cam0")
    return path


def virtual_kitti(short, path):
    """Scene01/clone of Virtual KITTI 2."""
    images = path / "frames/rgb/Camera_0"
    images.parent.mkdir(parents=True)
    folder(lambda i: f"rgb_{i:05}.png", times=None)(short, images)
    (fx, _, cx), (_, fy, cy), _ = camera_matrix(short).tolist()
    (path / "intrinsic.txt").write_text(f"frame cameraID K[0,0] K[1,1] K[0,2] K[1,2]\n0 0 {fx} {fy} {cx} {cy}\n")
    return path


def without_last_pose(path):
    poses = (path / "poses.txt").read_text().splitlines(keepends=True)
    (path / "poses.txt").write_text("".join(poses[:-1]))


def kitti(change):
    """The KITTI folder, changed."""
    def make(short, path):
        shutil.copytree(short, path)
        change(path)
        return path
    return make


def bag_of(change_image=None, change_info=None, topic=IMAGE, info=INFO, suffix=".bag", size=None):
    """The bag, whose images and calibrations are changed, or renamed, and cut off after some bytes."""
    def make(short, path):
        file, seen = path.with_suffix(".bag"), []

        def change(name, message):
            if name == IMAGE:
                return topic, change_image(message) if change_image else message
            if name != INFO:
                return None
            seen.append(message)
            changed = change_info(message, len(seen)) if change_info else message
            return (info, changed) if changed else None

        bags.copy(short.with_suffix(".bag"), file, change)
        target = path.with_name(path.name + suffix)
        target.write_bytes(file.read_bytes()[:size])
        return target
    return make


def grey_of(message):
    return np.frombuffer(message.data, np.uint8).reshape(message.height, message.width)


def with_pixels(message, pixels, encoding):
    message.encoding, message.step, message.data = encoding, pixels[0].nbytes, pixels.tobytes()
    message.height, message.width = pixels.shape[:2]
    return message


def as_png(message):
    data = cv2.imencode(".png", grey_of(message))[1].tobytes()
    return CompressedImage(header=message.header, format="mono8; png compressed ", data=data)


def unstamped(message):
    message.header.stamp = rospy.Time()
    return message


def full_roi(message, _):
    message.roi = RegionOfInterest(width=message.width, height=message.height)
    message.binning_x = message.binning_y = 1
    return message


def without_calibration(message, _):
    message.P = [0.0] * 12
    return message


def smaller(message, _):
    """The size of the images after they were halved, with the matrices of before."""
    message.width, message.height = message.width // 2, message.height // 2
    return message


def unsized(message, _):
    message.width = message.height = 0
    return message


def binned(message, _):
    message.binning_x = message.binning_y = 2
    return message


def halved(message):
    return with_pixels(message, np.ascontiguousarray(cv2.resize(grey_of(message), None, fx=0.5, fy=0.5,
                                                                interpolation=cv2.INTER_AREA)), "mono8")


def from_image(first, change):
    """The change from this image on."""
    count = itertools.count()
    return lambda message: change(message) if next(count) >= first else message


def from_info(first, change):
    return lambda message, i: change(message, i) if i > first else message


ZOOM = 1.25


def zoomed(message):
    image = grey_of(message)
    shift = [(1 - ZOOM) * (side - 1) / 2 for side in image.shape[::-1]]
    return with_pixels(message, cv2.warpAffine(image, np.array([[ZOOM, 0, shift[0]], [0, ZOOM, shift[1]]]),
                                               image.shape[::-1], borderMode=cv2.BORDER_REPLICATE), "mono8")


def zoomed_info(message, _):
    centre = {2: (message.width - 1) / 2, 6: (message.height - 1) / 2}
    message.P = [ZOOM * value + (1 - ZOOM) * centre.get(i, 0) if i in (0, 2, 5, 6) else value
                 for i, value in enumerate(message.P)]
    return message


def halved_info(message, i):
    message.P = [value / 2 if n in (0, 2, 5, 6) else value for n, value in enumerate(message.P)]
    return smaller(message, i)


def turned_round(message):
    return with_pixels(message, np.ascontiguousarray(cv2.rotate(grey_of(message), cv2.ROTATE_180)), "mono8")


def earlier(message):
    message.header.stamp -= rospy.Duration(1.5)
    return message


def every_fifth_two(change):
    """The change of two of five images."""
    count = itertools.count()
    return lambda message: change(message) if next(count) % 5 in (1, 3) else message


def two_cameras(short, path):
    """A merged bag: the images of a second camera on the same topic."""
    file = bag_of()(short, path)
    with rosbag.Bag(str(file), "a") as bag:
        for _, message, stamp in list(bag.read_messages([IMAGE])):
            message.header.frame_id = "second"
            message.header.stamp += rospy.Duration(0.05)
            bag.write(IMAGE, turned_round(message), stamp + rospy.Duration(0.05))
    return file


def with_definition(message_type, change):
    """The bag with another definition of a type of its messages."""
    def make(short, path):
        file = path.with_suffix(".bag")
        definition = change(message_type._full_text)
        md5 = genpy.dynamic.generate_dynamic(message_type._type, definition)[message_type._type]._md5sum
        with rosbag.Bag(str(short.with_suffix(".bag"))) as bag, rosbag.Bag(str(file), "w") as changed:
            for topic, (name, data, old, *_), stamp in bag.read_messages([IMAGE, INFO], raw=True):
                is_changed = name == message_type._type
                changed.write(topic, (name, data, md5 if is_changed else old, message_type), stamp, raw=True,
                              connection_header={"topic": topic, "type": name, "md5sum": md5 if is_changed else old,
                                                 "message_definition": definition if is_changed else TYPES[name]._full_text})
        return file
    return make


TYPES = {"sensor_msgs/Image": Image, "sensor_msgs/CameraInfo": CameraInfo}


def damaged(path):
    file = path / "image_0/000010.png"
    file.write_bytes(file.read_bytes()[:1000])


def second_camera(path):
    (path / "image_0").rename(path / "image_2")
    (path / "calib.txt").write_text((path / "calib.txt").read_text().replace("P0:", "P2:"))


CASES = {
    "folder": Case(folder()),
    "numbers from 100": Case(folder(lambda i: f"{i + 100}.PNG")),
    "12 bits": Case(folder(change=lambda image: image.astype(np.uint16) * 16)),
    "16 bits": Case(folder(change=lambda image: image.astype(np.uint16) * 257)),
    "colour": Case(folder(change=lambda image: cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))),
    "constant rate": Case(folder(times=None), ("--camera", "CAMERA", "--fps", 10)),
    "video": Case(video()),
    "one wrong stamp": Case(folder(times=lambda t: f"{t if round(10 * t) != 5 else 500:.1f}"), tolerance=0.02),
    "KITTI, image_2 only": Case(kitti(second_camera), ()),
    "KITTI, one pose too few": Case(kitti(without_last_pose), ()),
    "EuRoC": Case(euroc, ()),
    "EuRoC, the folder around mav0": Case(around_mav0, ()),
    "Virtual KITTI": Case(virtual_kitti, ("--fps", 10)),
    "MP4 with an edit list": Case(cut_video, tolerance=0.03, first=10),
    "bag": Case(bag_of(), ("--rectified",)),
    "12 bits in a bag, ROI of the whole image": Case(
        bag_of(lambda m: with_pixels(m, grey_of(m).astype(np.uint16) * 16, "mono16"), full_roi), ("--rectified",)),
    "rgb8 in a bag, a single camera_info without a size": Case(
        bag_of(lambda m: with_pixels(m, cv2.cvtColor(grey_of(m), cv2.COLOR_GRAY2RGB), "rgb8"),
               lambda m, i: unsized(m, i) if i == 1 else None), ("--rectified",)),
    "compressed images of any name": Case(bag_of(as_png, topic="/cam/jpeg", info="/cam/camera_info"), (),
                                          launch=("image:=/cam/jpeg", f"camera_height:={CAMERA_HEIGHT}")),
    "topics without a slash": Case(bag_of(topic="cam/image", info="cam/camera_info"), (),
                                   launch=("image:=/cam/image", f"camera_height:={CAMERA_HEIGHT}")),
    "binning": Case(bag_of(halved, binned), ("--rectified",), tolerance=0.03),

    "zoom in the bag": Case(bag_of(from_image(20, zoomed), from_info(20, zoomed_info)), ("--rectified",), tolerance=0.05,
                            python="the camera changes at image 2[01], from "),
    "another image size in the bag": Case(bag_of(from_image(20, halved), from_info(20, halved_info)), ("--rectified",),
                                          tolerance=0.05, python="the camera changes at image 2[01], from "),
    # Whether the camera moved while its clock was set is not known: an interval.
    "clock jumps back": Case(bag_of(from_image(20, earlier)), ("--rectified",), tolerance=0.04, doors=0.04),
    "camera_info on another topic": Case(bag_of(info="/lens/info"), ("--rectified", "--camera-info", "/lens/info"),
                                         launch=("camera_info:=/lens/info",)),

    "two cameras on one topic": Case(two_cameras, ("--rectified",), "two cameras publish on .*image_rect: images with the "
                                     'frame_id "camera_gray_left" are used, those with "second" are not',
                                     python='the camera changes at image 1 to the frame_id "second"'),
    "upside down": Case(bag_of(turned_round), ("--rectified",), "no metric pose: "),
    "two of five images of another size": Case(bag_of(every_fifth_two(halved)), ("--rectified",),
                                               "only 24 of 40 images could be used"),
    "camera_info of zeros": Case(bag_of(change_info=without_calibration), ("--rectified",),
                                 "is all zeros: .* `ground_scale_vo calibrate --fov DEGREES`"),
    "no definition": Case(with_definition(Image, lambda text: ""), ("--rectified",),
                          r"its sensor_msgs/Image has other fields than those of ROS 1 \(none\): convert it"),
    "fields of ROS 2": Case(with_definition(CameraInfo, lambda text: re.sub(r"(?m)^(float64\[\d*\]\s+)([DKRP])", lambda found:
                            found[1] + found[2].lower(), text)), ("--rectified",),
                            "its sensor_msgs/CameraInfo has other fields than those of ROS 1 .* d, k, r, p, .*convert it"),
    "stamps of zero": Case(bag_of(unstamped), ("--rectified",), "the stamp is zero"),
    "calibration of another size": Case(folder(change=lambda image: image[::2, ::2]), ("--camera", "CALIB"),
                                        "is of another image size: its principal point"),
    "calibration without a size, cropped images": Case(folder(change=lambda image: image[:200]), ("--camera", "CALIB"),
                                                       "calib.txt states no image size, and its principal point"),
    "camera_info of another size": Case(bag_of(halved, smaller), ("--rectified",),
                                        "is of another image size: its principal point"),
    "size in the file": Case(folder(change=lambda image: image[::2, ::2]),
                             refusal="the images are 400x124, but .* describes 800x248: are the images binned by 2"),
    "equal stamps": Case(folder(times="0\n" * FRAMES), refusal="no plausible frame rate|no usable stamps"),
    "no stamps": Case(folder(times=None), refusal="has no times.txt .* --fps N"),
    "truncated video": Case(video(share=0.5), refusal=f"ends early: only .* of {FRAMES} images"),
    "damaged image": Case(kitti(damaged), (), f"is damaged: 1 of {FRAMES} images cannot be decoded"),
    "other types of files": Case(folder(lambda i: f"{i}.bmp"), refusal="the images are .bmp files"),
    "nothing to track": Case(folder(change=np.zeros_like), refusal="no metric pose: the odometry is initialising"),
    "nothing to track in a bag": Case(bag_of(lambda m: with_pixels(m, np.zeros_like(grey_of(m)), "mono8")),
                                      ("--rectified",), "no metric pose: the odometry is initialising"),
    "unfinished recording": Case(bag_of(suffix=".bag.active", size=-2**16), ("--rectified",), "rosbag reindex"),
    "recording of ROS 2": Case(bag_of(suffix=".mcap"), ("--rectified",), "convert it"),
}


def through_command(gsv_command, path, options, out):
    """The exit status, the text, and the length of the path."""
    status, output, messages = gsv_command("run", path, "--camera-height", CAMERA_HEIGHT, "--out", out, *options)
    return status, output + messages, length_in(out)


def through_run_sequence(path, options, out):
    done = run(tool("run_sequence"), path, "--camera-height", CAMERA_HEIGHT, "--out", out, *options, check=False)
    return done.returncode, done.stdout + done.stderr, length_in(out)


def through_python(gsv, path, options):
    words = dict(zip(options, options[1:]))
    try:
        drive = gsv.open_drive(path, camera=words.get("--camera"), fps=float(words.get("--fps", 0)),
                               camera_info=words.get("--camera-info"), rectified="--rectified" in options)
        odometry = gsv.MetricOdometry(drive.camera, CAMERA_HEIGHT, mask=drive.mask, record=True)
        results = [odometry.process(*image) for image in drive]
    except gsv.DataError as error:
        return 1, str(error), None
    if all(result.pose is None for result in results):
        return 1, f"no metric pose: the odometry is {results[-1].status}", None
    return (1 if drive.failure else 0), drive.failure, length(odometry.poses()[:, :3, 3])


def through_launch(path, arguments, folder_of_log):
    log, record = folder_of_log / "log", folder_of_log / "recorded.bag"
    with roslaunch(log, "kitti.launch", f"bag:={path}", *arguments, "required:=true",
                   f"record:={record}") as (process, _):
        process.wait(TIMEOUT_S)
    text = log.read_text()
    played = re.search(r"Playback finished: .* length ([0-9.]+) m", text)
    if not played:
        return 1, text, None
    image = [word.replace("image:=", "") for word in arguments if word.startswith("image:=")]
    evaluated = run(tool("evaluate_bag"), "--played", path, "--recorded", record, "--out", folder_of_log / "nodelets",
                    "--camera-height", CAMERA_HEIGHT, *(["--image", *image] if image else []), check=False)
    return evaluated.returncode, text + evaluated.stderr, float(played[1])


def length_in(out, first=0):
    files = list(out.glob("*/poses.txt"))
    return length(np.loadtxt(files[0]).reshape(-1, 3, 4)[first:, :, 3]) if files else None


def length(positions):
    return np.linalg.norm(np.diff(positions, axis=0), axis=1).sum()


@pytest.mark.parametrize("name", CASES)
def test_every_door_gives_the_same(gsv, gsv_command, short, bag, evaluated, tmp_path, name):
    case = CASES[name]
    path = case.make(short, tmp_path / "drive")
    camera = write_camera(tmp_path / "camera.yaml", short)
    without_size = tmp_path / "calib.txt"
    without_size.write_text((short / "calib.txt").read_text().split("S0:")[0])
    words = {"CAMERA": camera, "CALIB": without_size}
    options = [words.get(word, word) for word in case.options]
    is_bag = ".bag" in path.name or path.suffix == ".mcap"
    results = {"run": through_command(gsv_command, path, options, tmp_path / "run"),
               "python": through_python(gsv, path, options)}
    if is_bag:
        results["nodelets"] = through_launch(path, case.launch, tmp_path)
    else:
        results["run_sequence"] = through_run_sequence(path, options, tmp_path / "run_sequence")
    for door, (status, text, length_m) in results.items():
        refusal = case.python if door == "python" and case.python else case.refusal
        if refusal:
            assert status == 1 and re.search(refusal, text), (door, text)
        else:
            assert status == 0, (door, text)
            assert length_m == pytest.approx(length_in(evaluated.parent, case.first), rel=case.tolerance), door
            assert length_m == pytest.approx(results["run"][2], rel=case.doors), door


def test_bag_launch_waits_for_both_nodelets(bag, tmp_path):
    """MonoVo starts last, and does not lose the first image. The queues are so long that no frame is dropped on a
    busy machine."""
    for file in (ROOT / "config").glob("*.yaml"):
        (tmp_path / file.name).write_text(re.sub(r"(?m)^queue_size: \d+", "queue_size: 1000", file.read_text()))
    released, wait = tmp_path / "released", tmp_path / "wait"
    wait.write_text(f'#!/bin/bash\nuntil [ -e {released} ]; do sleep 0.1; done\nexec "$@"\n')
    wait.chmod(0o755)
    nodelets = (ROOT / "launch/ground_scale_vo.launch").read_text()
    (tmp_path / "nodelets.launch").write_text(
        nodelets.replace('name="mono_vo"', f'name="mono_vo" launch-prefix="{wait}"'))
    delayed = tmp_path / "delayed.launch"
    delayed.write_text((ROOT / "launch/bag.launch").read_text().replace(
        "$(find ground_scale_vo)/launch/ground_scale_vo.launch", str(tmp_path / "nodelets.launch")))

    log = tmp_path / "log"
    arguments = [f"image:={IMAGE}", "image_is_rectified:=true", f"camera_height:={CAMERA_HEIGHT}"]
    with roslaunch(log, delayed, f"bag:={bag}", *arguments, f"config_dir:={tmp_path}") as (process, _):
        wait_until(lambda: f"_manager does not receive {IMAGE}" in log.read_text(), while_runs=process)
        released.touch()
        wait_until(lambda: f"Playback finished: {FRAMES} of {FRAMES} frames" in log.read_text(), while_runs=process)


def another_clock(stamp, speed):
    return speed_of(TwistStamped, 1)(stamp + rospy.Duration(100), speed)


@pytest.mark.parametrize("message, topic, unit, refusal", [
    (speed_of(TwistStamped, 1), SPEED, "", None),
    (speed_of(Odometry, 1), SPEED.lstrip("/"), "", None),
    (speed_of(TwistWithCovarianceStamped, 3.6), SPEED, "kmh", None),
    (speed_of(Float64, 3.6), SPEED, "kmh", None),
    (speed_of(Float32, 1), SPEED, "mps", None),
    (speed_of(Float32, 1), SPEED, "", "std_msgs/Float32, whose unit is not known"),
    (speed_of(TwistStamped, 1), "/wheels", "", f"topics with( a)? speed are .*{SPEED}"),
    (another_clock, SPEED, "", "no speed is used: the images are from .* to .* s, the speeds .*from .* to .* s: .*--speed-offset"),
    (speed_of(TwistStamped, 3.6), SPEED, "", "outside 0.2 to 4 m: their unit looks like km/h"),
    (speed_of(TwistStamped, 1000), SPEED, "", "m/s, .*mm/s|outside -200 to 200 m/s"),
])
def test_every_door_uses_the_same_speeds(gsv_command, bag, evaluated, tmp_path, message, topic, unit, refusal):
    """Without a camera height."""
    played = tmp_path / "drive.bag"
    bags.add_speed(bag, played, message)
    options = ("--speed", topic, *(("--speed-unit", unit) if unit else ()))
    status, output, messages = gsv_command("run", played, "--rectified", *options, "--out", tmp_path / "run")
    results = {"run": (status, output + messages, length_in(tmp_path / "run")),
               "nodelets": through_launch(played, (f"speed:={topic}", f"speed_unit:={unit}"), tmp_path)}
    for door, (status, text, length_m) in results.items():
        if refusal:
            assert status == 1 and re.search(refusal, text), (door, text)
        else:
            assert status == 0, (door, text)
            assert length_m == pytest.approx(length_in(evaluated.parent), rel=0.01), door
            assert length_m == pytest.approx(results["run"][2], rel=0.003), door


@pytest.mark.parametrize("make, argument, published, source", [
    (bags.add_speed, 'name="speed" value="/kitti/oxts/gps/vel"', "camera_gray_left", ScaleEstimate.SOURCE_BOTH),
    (bags.raw_drive, 'name="base_frame" value="imu_link"', "imu_link", ScaleEstimate.SOURCE_ROAD)])
def test_kitti_launch_gives_every_frame_one_parent(bag, tmp_path, make, argument, published, source):
    """Poses of the camera or of a base on /tf of the bag are the ground truth, which is published beside the
    estimate."""
    played, record, launch = (tmp_path / name for name in ("played.bag", "record.bag", "recorded.launch"))
    make(bag, played)
    launch.write_text(f'''<launch>
        <node pkg="rosbag" type="record" name="record_tf"
              args="-O {record} /tf /tf_static scale odometry ground_truth/odometry ground_truth/path"/>
        <include file="$(find ground_scale_vo)/launch/kitti.launch">
          <arg name="bag" value="{played}"/> <arg name="required" value="true"/> <arg {argument}/>
        </include>
      </launch>''')
    with roslaunch(tmp_path / "log", launch) as (process, _):
        process.wait(TIMEOUT_S)
    parents, last = {}, {}
    with rosbag.Bag(str(record)) as recorded:
        for topic, message, _ in recorded.read_messages():
            last[topic.lstrip("/")] = message
            for transform in getattr(message, "transforms", []):
                parents.setdefault(transform.child_frame_id, set()).add(transform.header.frame_id)
    assert parents.pop(published) == {"odom"} and all(len(names) == 1 for names in parents.values()), parents
    estimate, truth, path = (last[name] for name in ("odometry", "ground_truth/odometry", "ground_truth/path"))
    assert (estimate.child_frame_id, truth.child_frame_id) == (published, f"ground_truth/{published}")
    assert estimate.header.frame_id == truth.header.frame_id == path.header.frame_id == "odom"
    assert last["scale"].source == source
    estimated, true, of_path = (np.array([at.x, at.y, at.z]) for at in (
        estimate.pose.pose.position, truth.pose.pose.position, path.poses[-1].pose.position))
    length = np.linalg.norm(true)
    assert length > 10 and np.linalg.norm(estimated - true) < 0.08 * length + 1  # they may be of two images
    assert np.linalg.norm(of_path - true) < 1.1 and len(path.poses) > 10
