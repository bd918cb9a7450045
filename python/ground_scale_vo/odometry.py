"""What `import ground_scale_vo` provides, and the checks of its arguments."""

import json
import os
from typing import Any, Callable, Dict, Iterator, List, NamedTuple, Optional, Tuple, Union

import numpy as np

from . import _core, bags
from ._core import DataError

_LAST_STAMP_NS = 4294967295 * 10**9  # in the year 2106: the latest stamp of ROS


class Camera(NamedTuple):
    """A camera without distortion, as of rectified images. All in pixels; the centre of the upper
    left pixel is (0, 0).

    lens_is_estimated: the distortion that was removed from the images was estimated from drives
        (ground_scale_vo calibrate), so that the shape of the road is observable.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    lens_is_estimated: bool = False


class Result(NamedTuple):
    """What MetricOdometry.process() computed for one image.

    stamp: [ns] of the image.
    status: "tracking" (there is a pose), "initialising" or "lost".
    scale_status: "ok" (measured in this image), "held" (the last scale is kept) or "unknown".
    reason: why no measurement of this image was used; "none": one was used.
    map_id: grows with each new map, which has another scale.
    pose: (4, 4) float64, from this camera to that at the first image of the first map with a scale,
        translation in metres; None without a metric pose.
    covariance: (6, 6) float64 of the pose in the first camera's axes, position [m^2], then rotation
        [rad^2] as a left perturbation; None without a pose.
    scale: filtered, metres per unit of the odometry; None while unknown.
    sigma: standard deviation of scale; None while unknown.
    plane: (4,) float64, the road n . x + d = 0 in this camera's axes, n of length 1 and up, d the
        camera's height [m]; None while unknown.
    tracks: (N, 2) float32, tracked corners (u, v) [px].
    camera_height: [m] above the road, given or learned from speeds; None while neither.
    camera_height_sigma: its standard deviation [m]; 0: given as exact.
    source: what the scale was measured with: "road", "speed", "both", or "none".
    speed_error: why the speeds cannot be used, such as another unit, one sentence; empty: they can.
    speed_warning: what is wrong with the speeds, one sentence; empty: nothing.
    track_ids: (N,) uint64, ascending; constant while a corner is tracked.
    points: (N, 3) float32, the points of the tracks in this camera's axes [m]; NaN for a track
        without a point and while the scale is unknown.
    """

    stamp: int
    status: str
    scale_status: str
    reason: str
    map_id: int
    pose: Optional[np.ndarray]
    covariance: Optional[np.ndarray]
    scale: Optional[float]
    sigma: Optional[float]
    plane: Optional[np.ndarray]
    camera_height: Optional[float]
    camera_height_sigma: Optional[float]
    source: str
    speed_error: str
    speed_warning: str
    tracks: np.ndarray
    track_ids: np.ndarray
    points: np.ndarray


class Record:
    """The results of all images so far."""

    def __init__(self, get: Callable[[], Any]) -> None:
        self._get = get

    def poses(self) -> np.ndarray:
        """(N, 4, 4) float64: a pose of every image, from its camera to the first one [m]. Images
        without a metric pose hold the last one; those before the first metric pose get theirs from
        the first scale, or are the identity before the start of its map."""
        return self._get().poses()

    def metrics(self, ground_truth: Optional[np.ndarray] = None,
                ground_truth_heights: Optional[np.ndarray] = None) -> Dict[str, Any]:
        """The contents of metrics.json (docs/reference/commands.md): relative length error, errors of
        the KITTI devkit, consistency of the covariances, times. None where one is not known.

        ground_truth: (N, 4, 4), from each camera to the first one [m].
        ground_truth_heights: (N,), exact height of each camera above the road [m].
        """
        return json.loads(self._get().metrics(*_truth(ground_truth, ground_truth_heights)))

    def write(self, folder: Union[str, "os.PathLike[str]"], ground_truth: Optional[np.ndarray] = None,
              ground_truth_heights: Optional[np.ndarray] = None) -> None:
        """Writes the files of scripts/evaluate: poses.txt, trajectory_tum.txt, scale.csv, metrics.json
        and others. Ground truth as for metrics(). Raises DataError."""
        self._get().write(_path("folder", folder), *_truth(ground_truth, ground_truth_heights))


class MetricOdometry(Record):
    """Metric odometry of one camera: causal and deterministic. Calls from several threads are
    processed one after the other.

    camera: of the rectified images.
    camera_height: [m] above the road; 0: not known, which needs use_speed=True and add_speed().
    mask: (height, width) uint8, 0 where the images never show the scene (own vehicle, watermark);
        None: no such region.
    record: keep the results (about 3 kB an image) for poses(), metrics(), write() and smoothed().
    options: numbers and bools under the names of docs/reference/parameters.md, such as refine=False;
        names with a group as **{"tracker/cell_size": 0.02}.
    """

    def __init__(self, camera: Camera, camera_height: float, *, mask: Optional[np.ndarray] = None,
                 record: bool = False, **options: Union[float, bool]) -> None:
        if not isinstance(camera, Camera):
            raise _type_error("camera", camera, "a Camera")
        size = tuple(_integer(f"camera.{name}", getattr(camera, name), 100000)
                     for name in Camera._fields[:2])
        numbers = tuple(_number(f"camera.{name}", getattr(camera, name))
                        for name in Camera._fields[2:6])
        if not isinstance(camera.lens_is_estimated, bool):
            raise _type_error("camera.lens_is_estimated", camera.lens_is_estimated, "a bool")
        self._shape = size[::-1]
        self._odometry = _core.Odometry(
            size + numbers + camera[6:], _number("camera_height", camera_height),
            [_setting(name, value) for name, value in options.items()],
            None if mask is None else _mask(mask, self._shape), bool(record))
        super().__init__(self._odometry.record)

    def process(self, image: np.ndarray, stamp: int) -> Result:
        """Processes the next image of the drive, and releases the GIL meanwhile.

        image: (height, width) uint8 or uint16, grey, rectified. It is copied. Images of 10 to 16 bits are
            divided by the range in use, as in the nodelets.
        stamp: [ns], greater than the previous image's.
        """
        return Result(**self._odometry.process(_image("image", image, self._shape),
                                               _integer("stamp", stamp, _LAST_STAMP_NS)))

    def add_speed(self, stamp: int, speed: float, sigma: float = 0.0) -> None:
        """Adds a speed of the vehicle (option use_speed=True), in the order of the stamps, before or after the images
        of its time.

        stamp: [ns] of the clock of the images.
        speed: [m/s], negative: backwards.
        sigma: its standard deviation [m/s]; 0: the option speed_sigma.
        Raises ValueError without use_speed=True.
        """
        self._odometry.add_speed(_integer("stamp", stamp, _LAST_STAMP_NS), _number("speed", speed),
                                 _number("sigma", sigma))

    def smoothed(self) -> Record:
        """The results with each scale from all measurements of its map, also later ones: the first metres of a map
        have poses, and errors are smaller. Raises ValueError without record=True."""
        record = self._odometry.smoothed()
        return Record(lambda: record)


class Drive:
    """The images of a drive. Iterating over it reads them from the beginning and yields (image, stamp): rectified
    8-bit grey, and [ns], increasing. Images that cannot be used are left out.

    name: of the folder or file.
    camera: Camera of the rectified images.
    mask: (height, width) uint8 for MetricOdometry, 0 where the images never show the scene, or None.
    readout_time: [s] of a rolling shutter, for the option odometry/readout_time.
    ground_truth: (N, 4, 4) float64 of a KITTI folder, from each camera to the first one [m], or None.
    ground_truth_heights: (N,) float64, exact height of each camera above the road [m], or None.
    warnings: sentences about what is left out, and failure: why the images are not the whole drive, or "";
        complete after the last image.
    """

    def __init__(self, open_reader: Callable[[], Any], name: str) -> None:
        self._open, self.name = open_reader, name
        reader = open_reader()
        self._count: int = reader.count
        self.camera = Camera(*reader.camera)
        self.mask: Optional[np.ndarray] = reader.mask
        self.readout_time: float = reader.readout_time
        poses, heights = reader.ground_truth, reader.ground_truth_heights
        self.ground_truth: Optional[np.ndarray] = poses if len(poses) else None
        self.ground_truth_heights: Optional[np.ndarray] = np.array(heights) if heights else None
        self.warnings: List[str] = reader.warnings()
        self.failure = ""

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[Tuple[np.ndarray, int]]:
        reader = self._open()
        while True:
            image = reader.next()
            self.warnings, self.failure = reader.warnings(), "" if image else reader.failure()
            if image is None:
                return
            yield image


def open_drive(path: Union[str, "os.PathLike[str]"], *, camera: Union[str, "os.PathLike[str]", None] = None,
               mask: Union[str, "os.PathLike[str]", None] = None, fps: float = 0.0, topic: Optional[str] = None,
               camera_info: Optional[str] = None, rectified: bool = False, unrectified: bool = False) -> Drive:
    """Opens what `ground_scale_vo run` accepts: a KITTI folder, a folder of images with times.txt, a video or a bag.

    camera: file with the calibration of the images as they come; None: that of the KITTI folder or of the bag's
        camera_info.
    mask: image file, black where the images never show the scene.
    fps: [Hz] the images have this rate, and their stamps are not used; 0: stamps are used.
    topic: of the images of a bag; None: it has one image topic. camera_info: of their calibration; None: beside them.
    rectified: the images of the bag are rectified: P of its camera_info belongs to them.
    unrectified: the images of the KITTI raw drive are not rectified.
    Raises DataError, which names file and line or topic.
    """
    words = (_path("camera", camera or ""), 0.0, rectified, unrectified, _path("mask", mask or ""),
             _number("fps", fps), topic, camera_info)
    path = _path("path", path)
    return Drive(lambda: _open_reader(path, *words), _core.result_name(path))


def _open_reader(path, camera, fov, rectified, unrectified, mask, fps, topic, camera_info):
    """A _core.Reader. fov: [degrees] in place of a calibration; 0: none."""
    is_bag = path.endswith(".bag")
    if not is_bag:
        _core.require_no_bag(path)
    if rectified and (camera or fov or not is_bag):
        raise ValueError("rectified is for the camera_info of a bag, without a camera file or a field of view")
    if camera_info and (camera or fov or not is_bag):
        raise ValueError("camera_info is a topic of a bag, without a camera file or a field of view")
    if is_bag and unrectified:
        raise ValueError("unrectified is for a KITTI raw drive")
    if is_bag:
        return bags.open_bag(path, topic, camera_info, rectified, camera, fov, mask, fps)
    return _core.open_files(path, camera, fov, unrectified, mask, fps)


def _type_error(name: str, value: Any, needed: str) -> TypeError:
    return TypeError(f"{name} is of type {type(value).__name__}, it must be {needed}")


def _number(name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise _type_error(name, value, "a number")
    try:
        return float(value)
    except OverflowError:
        raise ValueError(f"{name} is too large") from None


def _integer(name: str, value: Any, largest: int) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        raise _type_error(name, value, "an integer" + (" [ns]" if name == "stamp" else ""))
    if not 0 <= value <= largest:
        raise ValueError(f"{name} is out of range, it must lie in [0, {largest}]")
    return int(value)


def _setting(name: str, value: Any) -> str:
    if isinstance(value, (bool, np.bool_)):
        return f"{name}={'true' if value else 'false'}"
    return f"{name}={_number(name, value)!r}"


def _array(name: str, value: Any, types: Tuple[Any, ...], needed: str,
           shape: Tuple[Optional[int], ...]) -> np.ndarray:
    if not isinstance(value, np.ndarray):
        raise _type_error(name, value, "a numpy array")
    if not any(np.issubdtype(value.dtype, one) for one in types):
        raise TypeError(f"{name} has the dtype {value.dtype}, it must be {needed}")
    if len(value.shape) != len(shape) or any(n not in (None, m) for n, m in zip(shape, value.shape)):
        text = str(shape).replace("None", "N")
        raise ValueError(f"{name} has the shape {value.shape}, it must be {text}")
    return value


def _image(name: str, value: Any, shape: Tuple[int, ...]) -> np.ndarray:
    array = _array(name, value, (np.uint8, np.uint16), "uint8 or uint16", shape)
    return np.ascontiguousarray(array, array.dtype.newbyteorder("="))


def _mask(value: Any, shape: Tuple[int, ...]) -> np.ndarray:
    return np.ascontiguousarray(_array("mask", value, (np.uint8,), "uint8", shape))


def _truth(poses: Any, heights: Any) -> Tuple[Optional[np.ndarray], Optional[np.ndarray]]:
    def reals(name, value, shape):
        if value is None:
            return None
        return np.ascontiguousarray(_array(name, value, (np.floating, np.integer), "a real number", shape), np.float64)
    return (reals("ground_truth", poses, (None, 4, 4)),
            reals("ground_truth_heights", heights, (None,)))


def _path(name: str, value: Any) -> str:
    if not isinstance(value, (str, os.PathLike)):
        raise _type_error(name, value, "a str or a path")
    text = os.fsdecode(value)
    if "\0" in text or any("\ud800" <= character <= "\udfff" for character in text):
        raise ValueError(f"{name} is {text!a}, it must be UTF-8 without null characters")
    return text
