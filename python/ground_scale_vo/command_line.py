"""The command ground_scale_vo: see --help."""

import argparse
import functools
import pathlib
import re
import sys

import numpy as np

from . import _core, bags, calibration, gps_track, many
from .odometry import DataError, _open_reader


def parse(words):
    parser = argparse.ArgumentParser(
        prog="ground_scale_vo", description="Metric monocular visual odometry without ROS.",
        epilog="Exit status: 0 done, 1 the data cannot be used or only in part (the reason is printed), 2 the arguments "
        "cannot be used.")
    parser.add_argument("--version", action="version", version=f"ground_scale_vo {_core.__version__}")
    commands = parser.add_subparsers(dest="command", required=True)
    add_run(commands.add_parser(
        "run", help="processes a drive and writes its trajectory and plots",
        description="Processes drives and writes their metric trajectories, tables, plots and a page, report.html, to "
        "DIR/NAME/. Ground truth of a KITTI folder is compared with the result.",
        epilog="Exit status: 0 the result is usable, 1 it is not, or not for the whole drive (the last line says why), 2 the "
        "arguments cannot be used."))
    add_calibrate(commands.add_parser(
        "calibrate", help="estimates the lens of a camera from drives with turns",
        description="Estimates focal length, principal point and radial distortion of a camera from drives with "
        "turns. For rectified images the distortion is what the rectification has left.",
        epilog="Exit status: 0 done, 1 the data cannot be used or do not determine the lens, 2 the arguments cannot "
        "be used. Files are written only with status 0."))
    add_calibrate_height(commands.add_parser(
        "calibrate_height", help="estimates the camera's height from a drive of known length",
        description="Runs the odometry over a drive of known length and prints the camera's height above the road and "
        "its mounting, with the 95 % intervals. One of --length with --length-sigma, --gps and --trajectory is needed.",
        epilog="Exit status: 0 done, 1 the data cannot be used or leave the height too uncertain, 2 the arguments cannot "
        "be used. FILE is written only with status 0."))
    # argparse takes a negative number in E notation for an option.
    return parser.parse_args([f"{float(word):.9f}" if re.fullmatch(r"-[\d.]+[eE][+-]?\d+", word) else word for word in words])


INPUT = dict(type=pathlib.Path, metavar="FOLDER|VIDEO|BAG",
             help="KITTI folder; folder of images with times.txt, a time in each line [s, ms, us or ns]; video; bag (needs the Python "
             "module rosbag)")
CAMERA = dict(type=pathlib.Path, metavar="FILE",
              help="calibration of the images as they come: YAML of ROS' camera_calibration or of calibrate, Kalibr "
              "camchain, OpenCV, ORB-SLAM or VINS, or KITTI calib.txt; required except for a KITTI folder and a bag with the topic camera_info beside the images")


def add_calibration(command):
    start = command.add_mutually_exclusive_group()
    start.add_argument("--camera", **CAMERA)
    start.add_argument("--fov", type=float, metavar="DEG",
                       help="horizontal field of view of the lens [degrees], 10 to 150, as on the box, when there is no "
                       "calibration: the lens is estimated from the drive, which needs turns; may be wrong by 15 %%. If it is "
                       "refused, try values within that")


def add_run(command):
    command.add_argument("inputs", nargs="+", **INPUT)
    command.add_argument("--jobs", type=int, default=1, metavar="N",
                         help="so many drives at a time; finished ones are not repeated. Several drives need the Python "
                         "module distributed")
    command.add_argument("--scheduler", metavar="ADDRESS", help="the drives are tasks of this Dask cluster: tcp://HOST:8786")
    add_calibration(command)
    command.add_argument("--refine-camera", action="store_true",
                         help="the default: estimate the lens error that the calibration has left while driving. "
                         "--set refine_camera=false: the calibration is exact")
    command.add_argument("--camera-height", type=float, metavar="M",
                         help="of the camera above the road [m]; required without --speed or --preset")
    command.add_argument("--preset", metavar="NAME",
                         help="known camera, such as kitti or nuscenes (docs/tutorials/your_camera.md): its height with the "
                         "standard deviation")
    command.add_argument("--speed", metavar="FILE|TOPIC",
                         help="speeds of the vehicle: CSV with the columns stamp and speed_mps, speed_kmh, speed_mph, "
                         "speed_knots or speed_mmps, optionally sigma; the folder oxts/ of a KITTI raw drive; or a topic of "
                         "the bag, Odometry, TwistStamped, TwistWithCovarianceStamped, Float32 or Float64")
    command.add_argument("--speed-unit", choices=("mps", "kmh", "mph", "knots", "mmps"),
                         help="of a column speed, or of the topic's messages (default: m/s; required for a column speed "
                         "without --camera-height, and for Float32 and Float64)")
    command.add_argument("--speed-offset", type=float, default=0.0, metavar="S",
                         help="added to the stamps of the speeds [s], when they are of another clock")
    add_gps(command, "the trajectory on the map: ")
    command.add_argument("--out", type=pathlib.Path, default=pathlib.Path("results"), metavar="DIR",
                         help="results go to DIR/<name of the input>/ (default: results)")
    command.add_argument("--smooth", action="store_true",
                         help="the best trajectory after the drive: the lens is estimated from all images first, and "
                         "each scale from all measurements of its map, also later ones")
    command.add_argument("--strict", action="store_true", help="exit status 1 also after a warning")
    add_common(command)


def add_gps(command, purpose=""):
    command.add_argument("--gps", metavar="FILE|TOPIC",
                         help=purpose + "fixes of a GPX or NMEA file, CSV with the columns stamp, latitude, longitude, a topic of "
                         "the bag (sensor_msgs/NavSatFix), or FILE.bag:TOPIC")
    command.add_argument("--gps-offset", type=finite, default=0.0, metavar="S",
                         help="added to the stamps of the positions [s], when they are of another clock")


def add_calibrate(command):
    command.add_argument("inputs", nargs="+", **INPUT)
    add_calibration(command)
    command.add_argument("--out", type=pathlib.Path, default=pathlib.Path("camera.yaml"), metavar="FILE",
                         help="YAML of camera_calibration (default: camera.yaml); beside it FILE.png with the mean "
                         "residuals over the image")
    command.add_argument("--force", action="store_true", help="replace existing files")
    add_common(command)


def add_calibrate_height(command):
    command.add_argument("input", **INPUT)
    command.add_argument("--camera", **CAMERA)
    command.add_argument("--length", type=float, metavar="M",
                         help="odometer reading between the first image and the last [m], and")
    command.add_argument("--length-sigma", type=float, metavar="M", help="its standard deviation [m]")
    add_gps(command)
    command.add_argument("--trajectory", type=pathlib.Path, metavar="FILE",
                         help="positions of a point fixed to the vehicle, in any frame: TUM (stamp x y z qx qy qz qw), or "
                         "KITTI poses, a line for each image")
    command.add_argument("--from", dest="start", type=float, default=0.0, metavar="S",
                         help="only from this time after the first image on [s]")
    command.add_argument("--to", dest="end", type=float, default=float("inf"), metavar="S",
                         help="only up to this time after the first image [s]")
    command.add_argument("--out", type=pathlib.Path, default=pathlib.Path("height.yaml"), metavar="FILE",
                         help="YAML, for height_file:= of the launch files (default: height.yaml)")
    command.add_argument("--force", action="store_true", help="replace FILE when it exists")
    add_common(command)


def add_common(command):
    command.add_argument("--rectified", action="store_true",
                         help="the images of the bag are rectified: P of its camera_info belongs to them")
    command.add_argument("--unrectified", action="store_true",
                         help="the images of a KITTI raw drive are not rectified: K and D are used")
    command.add_argument("--image", metavar="TOPIC", help="image topic of a bag with several")
    command.add_argument("--camera-info", metavar="TOPIC",
                         help="calibration in the bag (default: camera_info beside the images)")
    command.add_argument("--mask", type=pathlib.Path, metavar="FILE",
                         help="image, black where the camera's images never show the scene")
    command.add_argument("--fps", type=rate, default=0.0, metavar="HZ",
                         help="the images have this rate; their stamps are not used")
    command.add_argument("--options", type=pathlib.Path, metavar="FILE",
                         help="YAML with options, such as config/paper.yaml; --set takes precedence")
    command.add_argument("--set", action="append", default=[], metavar="NAME=VALUE",
                         help="option of the odometry (docs/reference/parameters.md); repeatable")


def rate(text):
    value = float(text)
    if not 0 < value <= 1000:
        raise argparse.ArgumentTypeError(f"{text} is not a rate in (0, 1000] Hz")
    return value


def finite(text):
    value = float(text)
    if not abs(value) < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not a finite number")
    return value


def field_of_view(arguments):
    """[degrees]; 0: not given."""
    if arguments.fov is not None and not arguments.fov > 0:  # positive ones are checked with the images
        raise ValueError(f"the field of view [degrees] is {arguments.fov:g}, it must lie in [10, 150]")
    return arguments.fov or 0.0


def opener(path, arguments, fov=0.0):
    """A function that opens the drive; each call reads it from the beginning."""
    return functools.partial(_open_reader, str(path), str(arguments.camera or ""), fov, arguments.rectified,
                             arguments.unrectified, str(arguments.mask or ""), arguments.fps, arguments.image,
                             arguments.camera_info)


def draw(folder):
    try:
        from . import plot_run  # installed beside this file
    except ImportError as error:
        print(f"no plots: {error}", file=sys.stderr)
    else:
        plot_run.draw(folder)


def write_page(folder, open_reader):
    try:
        from . import run_page  # installed beside this file
    except ImportError as error:
        print(f"no report.html: {error}", file=sys.stderr)
    else:
        run_page.write(folder, ["ground_scale_vo", *sys.argv[1:]], lambda frames: open_reader().images_at(frames))


def run(arguments):
    if arguments.jobs < 1:
        raise ValueError("--jobs must be at least 1")
    if arguments.preset:
        use_preset(arguments)
    if len(arguments.inputs) > 1 or arguments.scheduler:
        return many.run(arguments)
    arguments.input = arguments.inputs[0]
    return run_drive(arguments)


def use_preset(arguments):
    if arguments.camera_height is not None:
        raise ValueError(f"--preset {arguments.preset} and --camera-height are two heights: give one")
    from . import presets  # installed beside this file
    camera = presets.preset(arguments.preset)
    arguments.camera_height = camera["camera_height"]
    arguments.set = [f"camera_height_sigma={camera['camera_height_sigma']}", *arguments.set]


def run_drive(arguments):
    name = _core.result_name(str(arguments.input))
    folder = arguments.out / name
    if folder.resolve() == arguments.input.resolve():
        raise ValueError(f"--out {arguments.out} would write the results to the input")
    if arguments.camera_height is None and not arguments.speed:
        raise ValueError("--camera-height is needed, or --preset or --speed, see --help")
    if arguments.gps_offset and not arguments.gps:
        raise ValueError("--gps-offset is for --gps")
    fixes = gps_track.read(arguments.gps, str(arguments.input)) if arguments.gps else None
    speeds, sentence = read_speeds(arguments)
    if sentence:
        print(f"{name}: {sentence}", file=sys.stderr)
    open_reader = opener(arguments.input, arguments, field_of_view(arguments))
    result = _core.run(open_reader, name, arguments.camera_height or 0.0, arguments.set, speeds, arguments.speed_offset,
                       str(folder), arguments.smooth, bool(arguments.fov), arguments.strict)
    if fixes and np.isfinite(result["covariances"]).any():
        print(fixes)
        gps_track.add_to(folder, result, fixes, arguments.gps_offset, arguments.camera_height)
    draw(folder)
    write_page(folder, open_reader)
    for sentence in result["warnings"]:
        print(f"{name}: {sentence}", file=sys.stderr)
    print(f"{name}: {result['summary']}; written to {folder}", flush=True)
    if result["failure"]:
        print(f"{name}: {result['failure']}", file=sys.stderr)
    return result["status"]


def read_speeds(arguments):
    """The speeds, and a sentence about those that are left out, or ""."""
    if not arguments.speed:
        if arguments.speed_unit or arguments.speed_offset:
            raise ValueError("--speed-unit and --speed-offset are for --speed")
        return [], ""
    unit = arguments.speed_unit or ""
    if arguments.input.suffix == ".bag" and not pathlib.Path(arguments.speed).exists():
        return bags.speeds(str(arguments.input), arguments.speed, unit)
    return _core.read_speeds(arguments.speed, unit, arguments.camera_height is not None), ""


def calibrate(arguments):
    fov = field_of_view(arguments)
    # The further drives are of the same camera.
    drives = [opener(path, arguments, fov) for path in arguments.inputs]
    names = [_core.result_name(str(path)) for path in arguments.inputs]
    _core.calibrate_lens(drives, names, fov > 0, arguments.set, str(arguments.out), arguments.force)
    return 0


def calibrate_height(arguments):
    given = (arguments.length is not None, bool(arguments.gps), bool(arguments.trajectory))
    if sum(given) != 1:
        raise ValueError("one of --length, --gps and --trajectory is needed, see --help")
    if given[0] != (arguments.length_sigma is not None):
        raise ValueError("--length and --length-sigma go together, see --help")
    if given[0] and not (arguments.length > 0 and 0 <= arguments.length_sigma < float("inf")):
        raise ValueError("--length must be positive, and --length-sigma not negative")
    if not arguments.end > arguments.start:
        raise ValueError("--to must be greater than --from")
    drive = str(arguments.input)
    calibration.estimate_height(opener(drive, arguments), _core.result_name(drive), drive, arguments)
    return 0


def main():
    arguments = parse(sys.argv[1:])
    return execute(globals()[arguments.command], arguments)


def execute(command, arguments):
    """The exit status."""
    try:
        if getattr(arguments, "options", None):
            arguments.set = _core.read_options(str(arguments.options)) + arguments.set
        return command(arguments)
    except (ValueError, OSError) as error:
        print(f"ground_scale_vo: {error}", file=sys.stderr)
        return 1 if isinstance(error, (DataError, OSError)) else 2
