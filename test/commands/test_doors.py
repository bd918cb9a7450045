"""Every door gives the same metres, or refuses: the inputs of users through the command `ground_scale_vo run`, the
Python module, run_sequence and, for bags, kitti.launch. A new kind of input is a row of CASES."""

import re
import shutil
from typing import Any, Callable, NamedTuple, Optional

import bags
import cv2
import numpy as np
import pytest
import rosbag
import rospy
from bags import IMAGE, INFO
from conftest import (CAMERA_HEIGHT, FRAMES, ROOT, TIMEOUT_S, camera_matrix, images_of, roslaunch, run, tool, wait_until,
                      write_camera)
from geometry_msgs.msg import TwistStamped
from ground_scale_vo.msg import ScaleEstimate
from sensor_msgs.msg import CompressedImage, RegionOfInterest


class Case(NamedTuple):
    """make(short, path): writes the input, of which path is a free name without extension, and returns its path.
    options: of the commands; the word CAMERA stands for a calibration file.
    refusal: what every door says (a regular expression), with exit status 1; None: all give the same path.
    tolerance: of the path's length compared to the plain drive [share]. launch: arguments of kitti.launch."""

    make: Callable[[Any, Any], Any]
    options: tuple = ("--camera", "CAMERA")
    refusal: Optional[str] = None
    tolerance: float = 0.001
    launch: tuple = ()


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


def smaller(message, _):
    """The size of the images after they were halved, with the matrices of before."""
    message.width, message.height = message.width // 2, message.height // 2
    return message


def binned(message, _):
    message.binning_x = message.binning_y = 2
    return message


def halved(message):
    return with_pixels(message, np.ascontiguousarray(cv2.resize(grey_of(message), None, fx=0.5, fy=0.5,
                                                                interpolation=cv2.INTER_AREA)), "mono8")


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
    "Virtual KITTI": Case(virtual_kitti, ("--fps", 10)),
    "MP4 with an edit list": Case(cut_video, tolerance=0.03),
    "bag": Case(bag_of(), ("--rectified",)),
    "12 bits in a bag": Case(bag_of(lambda m: with_pixels(m, grey_of(m).astype(np.uint16) * 16, "mono16")), ("--rectified",)),
    "rgb8 in a bag": Case(bag_of(lambda m: with_pixels(m, cv2.cvtColor(grey_of(m), cv2.COLOR_GRAY2RGB), "rgb8")),
                          ("--rectified",)),
    "compressed images of any name": Case(bag_of(as_png, topic="/cam/jpeg", info="/cam/camera_info"), (),
                                          launch=("image:=/cam/jpeg", f"camera_height:={CAMERA_HEIGHT}")),
    "topics without a slash": Case(bag_of(topic="cam/image", info="cam/camera_info"), (),
                                   launch=("image:=/cam/image", f"camera_height:={CAMERA_HEIGHT}")),
    "ROI of the whole image": Case(bag_of(change_info=full_roi), ("--rectified",)),
    "binning": Case(bag_of(halved, binned), ("--rectified",), tolerance=0.03),
    "a single camera_info": Case(bag_of(change_info=lambda m, i: m if i == 1 else None), ("--rectified",)),

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
    """The exit status, the text, and the path."""
    status, output, messages = gsv_command("run", path, "--camera-height", CAMERA_HEIGHT, "--out", out, *options)
    return status, output + messages, poses_in(out)


def through_run_sequence(path, options, out):
    done = run(tool("run_sequence"), path, "--camera-height", CAMERA_HEIGHT, "--out", out, *options, check=False)
    return done.returncode, done.stdout + done.stderr, poses_in(out)


def through_python(gsv, path, options):
    words = dict(zip(options[::2], options[1::2]))
    try:
        drive = gsv.open_drive(path, camera=words.get("--camera"), fps=float(words.get("--fps", 0)),
                               rectified="--rectified" in options)
        odometry = gsv.MetricOdometry(drive.camera, CAMERA_HEIGHT, mask=drive.mask, record=True)
        results = [odometry.process(*image) for image in drive]
    except gsv.DataError as error:
        return 1, str(error), None
    if all(result.pose is None for result in results):
        return 1, f"no metric pose: the odometry is {results[-1].status}", None
    return (1 if drive.failure else 0), drive.failure, odometry.poses()[:, :3, 3]


def through_launch(path, arguments, folder_of_log):
    log, record = folder_of_log / "log", folder_of_log / "recorded.bag"
    with roslaunch(log, "kitti.launch", f"bag:={path}", *arguments, "required:=true",
                   f"record:={record}") as (process, _):
        process.wait(TIMEOUT_S)
    text = log.read_text()
    if not re.search(rf"Playback finished: {FRAMES} of {FRAMES}", text):
        return 1, text, None
    with rosbag.Bag(str(record)) as recorded:
        positions = [message.pose.pose.position for _, message, _ in recorded.read_messages(["odometry"])]
    return 0, text, np.array([(p.x, p.y, p.z) for p in positions])


def poses_in(out):
    files = list(out.glob("*/poses.txt"))
    return np.loadtxt(files[0]).reshape(-1, 3, 4)[:, :, 3] if files else None


def length(positions, last):
    """The length of the path of the last images: the nodelets publish none before the first scale."""
    return np.linalg.norm(np.diff(positions[-last:], axis=0), axis=1).sum()


@pytest.fixture(scope="module")
def plain(evaluated):
    return np.loadtxt(evaluated / "poses.txt").reshape(-1, 3, 4)[:, :, 3]


@pytest.mark.parametrize("name", CASES)
def test_every_door_gives_the_same(gsv, gsv_command, short, bag, plain, tmp_path, name):
    case = CASES[name]
    path = case.make(short, tmp_path / "drive")
    camera = write_camera(tmp_path / "camera.yaml", short)
    words = {"CAMERA": camera, "CALIB": short / "calib.txt"}
    options = [words.get(word, word) for word in case.options]
    is_bag = ".bag" in path.name or path.suffix == ".mcap"
    results = {"run": through_command(gsv_command, path, options, tmp_path / "run"),
               "python": through_python(gsv, path, options)}
    if is_bag:
        results["nodelets"] = through_launch(path, case.launch, tmp_path)
    else:
        results["run_sequence"] = through_run_sequence(path, options, tmp_path / "run_sequence")
    for door, (status, text, positions) in results.items():
        if case.refusal:
            assert status == 1 and re.search(case.refusal, text), (door, text)
        else:
            assert status == 0, (door, text)
            last = min(len(positions), len(plain)) - 10
            assert length(positions, last) == pytest.approx(length(plain, last), rel=case.tolerance), door
            reference = results["run"][2]
            assert length(positions, last) == pytest.approx(length(reference, last), rel=0.001), door


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


def add_speed(source, file):
    """The bag with the speed of its ground truth."""
    bags.copy(source, file, lambda *written: written)
    with rosbag.Bag(str(file), "a") as played:
        truth = [message.transforms[0] for _, message, _ in played.read_messages(["/tf"])]
        positions = [[getattr(transform.transform.translation, axis) for axis in "xyz"] for transform in truth]
        stamps = [transform.header.stamp for transform in truth]
        velocities = np.gradient(positions, [stamp.to_sec() for stamp in stamps], axis=0)
        for stamp, speed in zip(stamps, np.linalg.norm(velocities, axis=1)):
            twist = TwistStamped(header=truth[0].header)
            twist.header.stamp, twist.twist.linear.x = stamp, speed
            played.write("/kitti/oxts/gps/vel", twist, stamp)


@pytest.mark.parametrize("make, argument, published, source", [
    (add_speed, 'name="speed" value="/kitti/oxts/gps/vel"', "camera_gray_left", ScaleEstimate.SOURCE_BOTH),
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
