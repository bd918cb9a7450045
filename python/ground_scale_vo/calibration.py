"""Calibration files of cameras, and the rectification of their images."""

import pathlib
import re
from typing import Any, NamedTuple, Optional, Tuple

import cv2
import numpy as np

from . import Camera, DataError

# Distortion models of ROS and Kalibr: whether OpenCV has them in cv2.fisheye.
_IS_FISHEYE = {"plumb_bob": False, "rational_polynomial": False, "radtan": False, "none": False,
               "equidistant": True, "fisheye": True}


_MAX_READOUT_TIME = 0.2  # [s], that of the option odometry/readout_time


class Calibration(NamedTuple):
    """size: (width, height) [px], None if the file does not contain it. K: (3, 3) [px]. model: of
    _IS_FISHEYE. D: distortion coefficients of OpenCV, all zero without distortion. is_estimated: from drives,
    Camera.lens_is_estimated. readout_time: [s] of a rolling shutter."""

    size: Optional[Tuple[int, int]]
    K: np.ndarray
    model: str
    D: np.ndarray
    is_estimated: bool = False
    readout_time: float = 0.0

    @property
    def is_fisheye(self) -> bool:
        return _IS_FISHEYE[self.model]

    @classmethod
    def of(cls, camera: Camera) -> "Calibration":
        K = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
        return cls((camera.width, camera.height), K, "none", np.zeros(4))


def read_calibration(file: pathlib.Path) -> Calibration:
    """Reads the YAML of ROS' camera_calibration, a Kalibr camchain (cam0), or a KITTI calib.txt (P0 of
    rectified images). Raises DataError, which names the file."""
    try:
        calibration = _parse(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise DataError(f"{file}: {error.strerror}") from None
    except KeyError as error:
        raise DataError(f"{file}: has no {error}, which camera_calibration and Kalibr write") from None
    except (TypeError, ValueError, ImportError) as error:
        raise DataError(f"{file}: cannot be used as a calibration ({error})") from None
    return _checked(calibration, file)


def calibration_of(info: Any, topic: str, is_rectified: bool) -> Calibration:
    """Of a sensor_msgs/CameraInfo: of its rectified images (P), or of the raw ones (K and D, or P if only P
    is filled in). Raises DataError, which names the topic."""
    if max(info.binning_x, info.binning_y) > 1 or info.roi.width or info.roi.height:
        raise DataError(f"{topic}: binning and regions of interest are not supported, pass --camera")
    K, P = np.array(info.K, float).reshape(3, 3), np.array(info.P, float).reshape(3, 4)[:, :3]
    size = (info.width, info.height)
    if is_rectified or not K.any():
        if not P.any():
            raise DataError(f"{topic}: is not calibrated, P is zero")
        return _checked(Calibration(size, P, "none", np.zeros(4)), topic)
    try:
        model = _known_model(info.distortion_model or "none")
    except ValueError as error:
        raise DataError(f"{topic}: {error}") from None
    return _checked(Calibration(size, K, model, np.array(info.D, float)), topic)


def _checked(calibration, name):
    if not (np.isfinite(calibration.K).all() and np.isfinite(calibration.D).all()):
        raise DataError(f"{name}: has numbers that are not finite")
    for length in calibration.K[[0, 1], [0, 1]]:
        if not 1 <= length <= 1e6:
            raise DataError(f"{name}: has a focal length of {length:.10g} px")
    counts = (4,) if calibration.is_fisheye else (0, 4, 5, 8, 12, 14)
    if calibration.D.size not in counts:
        raise DataError(f"{name}: has {calibration.D.size} distortion coefficients, its model has "
                        f"{' or '.join(map(str, counts))}")
    if not 0 <= calibration.readout_time <= _MAX_READOUT_TIME:
        raise DataError(f"{name}: readout_time is not in [0, {_MAX_READOUT_TIME}] s")
    return calibration


def _parse(text):
    rectified = re.search(r"^(?:P0|P_rect_00):(.*)", text, re.MULTILINE)
    if rectified:
        return Calibration(None, np.array(rectified[1].split(), float).reshape(3, 4)[:, :3], "none", np.zeros(4))
    import yaml
    try:
        data = yaml.safe_load(text)
    except yaml.YAMLError:
        data = None
    if not isinstance(data, dict):
        raise ValueError("it is neither YAML of a camera nor a KITTI calib.txt")
    if "cam0" not in data:  # ROS
        return Calibration((data["image_width"], data["image_height"]),
                           np.array(data["camera_matrix"]["data"], float).reshape(3, 3),
                           _known_model(data["distortion_model"]),
                           np.array(data["distortion_coefficients"]["data"], float),
                           data.get("estimated_from_drives") is True, float(data.get("readout_time", 0)))
    data = data["cam0"]
    if data["camera_model"] != "pinhole":
        raise ValueError(f"the camera model is {data['camera_model']}, supported is pinhole")
    fx, fy, cx, cy = data["intrinsics"]
    width, height = data["resolution"]
    return Calibration((width, height), np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], float),
                       _known_model(data["distortion_model"]), np.array(data["distortion_coeffs"], float))


def _known_model(model):
    if model not in _IS_FISHEYE:
        raise ValueError(f"the distortion model is {model}, supported are {', '.join(_IS_FISHEYE)}")
    return model


class Rectification:
    """Rectifies grey images of this size; camera: of the rectified ones, which keep K."""

    def __init__(self, calibration: Calibration, size: Tuple[int, int]) -> None:
        if calibration.size not in (None, size):
            turned = calibration.size == size[::-1]
            raise DataError("the images are {}x{}, the calibration is of {}x{}{}".format(
                *size, *calibration.size, ": calibrate with images that are turned alike" * turned))
        self._shape = size[::-1]
        K, D = calibration.K, calibration.D
        self.camera = Camera(*size, *map(float, (K[0, 0], K[1, 1], K[0, 2], K[1, 2])), calibration.is_estimated)
        self._maps = None
        if calibration.is_fisheye:
            self._maps = cv2.fisheye.initUndistortRectifyMap(K, D, np.eye(3), K, size, cv2.CV_16SC2)
        elif D.any():
            self._maps = cv2.initUndistortRectifyMap(K, D, None, K, size, cv2.CV_16SC2)

    def image(self, grey: np.ndarray) -> np.ndarray:
        return self._rectified(grey, "an image")

    def mask(self, grey: Optional[np.ndarray]) -> Optional[np.ndarray]:
        """Masked (0) is what depends on a masked pixel of `grey` or lies outside the raw image; None if nothing."""
        raw = 255 * (np.ones(self._shape, bool) if grey is None else grey > 0).astype(np.uint8)
        visible = self._rectified(raw, "the mask") == 255
        return None if visible.all() else 255 * visible.astype(np.uint8)

    def _rectified(self, grey, name):
        if grey.shape != self._shape:  # cv2.remap would accept it
            raise DataError("{} is {}x{}, the first image {}x{}".format(
                name, *grey.shape[::-1], *self._shape[::-1]))
        return grey if self._maps is None else cv2.remap(grey, *self._maps, cv2.INTER_LINEAR)
