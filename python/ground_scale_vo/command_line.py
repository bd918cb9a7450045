"""The command ground_scale_vo: see --help."""

import argparse
import functools
import inspect
import pathlib
import re
import sys
import time

from . import DataError, MetricOdometry, lens_calibration, read_kitti
from .calibration import Calibration, Rectification, calibration_of, read_calibration
from .images import Images, open_images, read_grey


class Progress:
    """A line on the terminal that is overwritten; nothing elsewhere."""

    def __init__(self, name, count):
        self.name, self.count, self.done = name, max(count, 1), 0
        self.start = self.shown = time.monotonic()

    def step(self):
        self.done += 1
        now = time.monotonic()
        if sys.stderr.isatty() and (now - self.shown > 0.2 or self.done == self.count):
            self.shown = now
            bar = "#" * min(30, 30 * self.done // self.count)
            print(f"\r{self.name}: [{bar:30}] {self.done}/{self.count}, "
                  f"{self.done / (now - self.start):.1f}/s\033[K", end="", file=sys.stderr, flush=True)

    def end(self):
        if sys.stderr.isatty():
            print(file=sys.stderr)


def parse(arguments):
    parser = argparse.ArgumentParser(
        prog="ground_scale_vo", description="Metric monocular visual odometry without ROS.",
        epilog="Exit status: 0 done, 1 the data cannot be used, 2 the arguments cannot be used.")
    commands = parser.add_subparsers(dest="command", required=True)
    add_run(commands.add_parser("run", help="processes a drive and writes its trajectory and plots"))
    add_calibrate(commands.add_parser(
        "calibrate", help="estimates the lens of a camera from drives with turns",
        description="Estimates focal length, principal point and radial distortion of a camera from drives with "
        "turns. For rectified images the distortion is what the rectification has left.",
        epilog="Exit status: 0 done, 1 the data cannot be used or do not determine the lens, 2 the arguments cannot "
        "be used. Files are written only with status 0."))
    return parser.parse_args(arguments)


INPUT = dict(type=pathlib.Path, metavar="FOLDER|VIDEO|BAG",
             help="KITTI folder; folder of images with times.txt, a line [s] for each; video; bag (needs the Python "
             "module rosbag)")
CAMERA = dict(type=pathlib.Path, metavar="FILE",
              help="calibration: YAML of ROS' camera_calibration or of calibrate, Kalibr camchain, or KITTI calib.txt; "
              "required except for a KITTI folder and a bag with the topic camera_info beside the images")


def add_run(command):
    command.add_argument("input", **INPUT)
    command.add_argument("--camera", **CAMERA)
    command.add_argument("--refine-camera", action="append_const", dest="set", default=[], const=("refine_camera", True),
                         help="estimate the lens error that the calibration has left while driving")
    command.add_argument("--camera-height", type=float, required=True, metavar="M",
                         help="of the camera above the road [m]")
    command.add_argument("--out", type=pathlib.Path, default=pathlib.Path("results"), metavar="DIR",
                         help="results go to DIR/<name of the input>/ (default: results)")
    command.add_argument("--mask", type=pathlib.Path, metavar="FILE",
                         help="image, black where the camera's images never show the scene")
    add_common(command)


def add_calibrate(command):
    command.add_argument("inputs", nargs="+", **INPUT)
    start = command.add_mutually_exclusive_group()
    start.add_argument("--camera", **CAMERA)
    start.add_argument("--fov", type=float, metavar="DEG",
                       help="horizontal field of view, when there is no calibration; may be wrong by 15 %%")
    command.add_argument("--out", type=pathlib.Path, default=pathlib.Path("camera.yaml"), metavar="FILE",
                         help="YAML of camera_calibration (default: camera.yaml); beside it FILE.png with the mean "
                         "residuals over the image")
    command.add_argument("--force", action="store_true", help="replace existing files")
    add_common(command)


def add_common(command):
    command.add_argument("--rectified", action="store_true",
                         help="the images of the bag are rectified: P of its camera_info belongs to them")
    command.add_argument("--image", metavar="TOPIC", help="image topic of a bag with several")
    command.add_argument("--set", type=setting, action="append", default=[], metavar="NAME=VALUE",
                         help="option of the odometry (docs/reference/parameters.md); repeatable")


def setting(text):
    name, _, value = text.partition("=")
    return name, value == "true" if value in ("true", "false") else float(value)


def open_drive(path, arguments):
    """The images, their calibration, and for metrics the ground truth of a KITTI folder, where known."""
    if arguments.rectified and (arguments.camera or path.suffix != ".bag"):
        raise ValueError("--rectified is for the camera_info of a bag, without --camera")
    calibration = arguments.camera and read_calibration(arguments.camera)
    if is_kitti(path):
        drive = read_kitti(path)
        calibration = calibration or Calibration.of(drive.camera)
        return Images(len(drive), iter(drive)), calibration, (drive.ground_truth, drive.ground_truth_heights)
    if calibration is None and path.suffix != ".bag":
        option = "--camera or --fov" if arguments.command == "calibrate" else "--camera"
        raise ValueError(f"{option} is missing; only a KITTI folder and a bag contain their calibration")
    images = open_images(path, arguments.image)
    return images, calibration or calibration_in_bag(images, path, arguments), ()


def is_kitti(path):
    return (path / "image_0").is_dir() or (path / "image_00").is_dir()


def calibration_in_bag(images, path, arguments):
    if images.info is None:
        raise ValueError(f"--camera is missing; {path} has no {images.info_topic}")
    calibration = calibration_of(images.info, images.info_topic, arguments.rectified)
    if calibration.D.any() and re.search("rect[^/]*(/compressed)?$", images.topic):
        print(f"{images.topic} seems to hold rectified images, but {images.info_topic} has distortion: "
              "if they are rectified, add --rectified", file=sys.stderr)
    return calibration


def process(drive, calibration, arguments):
    """The odometry after the last image."""
    odometry, last_stamp, skipped = None, -1, 0
    progress = Progress(arguments.input.resolve().name, drive.count)
    for image, stamp in drive.images:
        if odometry is None:
            rectification = Rectification(calibration, image.shape[::-1])
            mask = rectification.mask(arguments.mask and read_grey(arguments.mask))
            options = {"odometry/readout_time": calibration.readout_time, **dict(arguments.set)}
            odometry = MetricOdometry(rectification.camera, arguments.camera_height, mask=mask,
                                      record=True, **options)
        if stamp > last_stamp:
            odometry.process(rectification.image(image), stamp)
        else:
            skipped += 1
        last_stamp = max(stamp, last_stamp)
        progress.step()
    progress.end()
    if odometry is None:
        raise DataError(f"{arguments.input}: has no image that can be decoded")
    if skipped:
        print(f"{skipped} images are skipped: their stamps do not increase", file=sys.stderr)
    return odometry


def draw(folder):
    try:
        from . import plot_run  # installed beside this file
    except ImportError as error:
        print(f"no plots: {error}", file=sys.stderr)
    else:
        plot_run.draw(folder, pdf=False)


def run(arguments):
    for name, _ in arguments.set:
        if name in ("self", *inspect.signature(MetricOdometry).parameters):
            raise ValueError(f"there is no option {name}")
    drive, calibration, ground_truth = open_drive(arguments.input, arguments)
    path = arguments.input.resolve()
    folder = arguments.out / (path.name if path.is_dir() else path.stem)
    if folder.resolve() == path:
        raise ValueError(f"--out {arguments.out} would write the results to the input")
    odometry = process(drive, calibration, arguments)
    odometry.write(folder, *ground_truth)
    draw(folder)
    metrics = odometry.metrics(*ground_truth)
    print(f"{folder.name}: {metrics['frames']} frames, {metrics['tracked_frames']} tracked, "
          f"{metrics['length_m']:.1f} m, written to {folder}")


def calibrate(arguments):
    if arguments.rectified and arguments.fov is not None:
        raise ValueError("--rectified is for the camera_info of a bag, without --fov")
    files = lens_calibration.output_files(arguments.out, arguments.force)

    def reopen(path):
        if not is_kitti(path):
            return open_images(path, arguments.image)
        drive = read_kitti(path)
        return Images(len(drive), iter(drive))
    drives = [lens_calibration.Drive(path.resolve().name, functools.partial(reopen, path), Progress)
              for path in arguments.inputs]
    if arguments.fov is None:
        calibration = open_drive(arguments.inputs[0], arguments)[1]
    else:
        calibration = lens_calibration.of_field_of_view(arguments.fov, drives[0].size())
    lens_calibration.check(calibration, arguments.camera or arguments.inputs[0])
    if calibration.size is None:  # of a KITTI calib.txt
        calibration = calibration._replace(size=drives[0].size())
    lens_calibration.estimate(drives, calibration, arguments.fov is not None, arguments.set, files)


def main():
    arguments = parse(sys.argv[1:])
    try:
        {"run": run, "calibrate": calibrate}[arguments.command](arguments)
    except (ValueError, OSError) as error:
        print(f"ground_scale_vo: {error}", file=sys.stderr)
        return 1 if isinstance(error, (DataError, OSError)) else 2
    return 0
