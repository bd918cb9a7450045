"""Estimates the lens of a camera from drives: ground_scale_vo calibrate."""

import math
import pathlib
import sys
from typing import Any, Callable, Iterable, List, NamedTuple, Tuple

import cv2
import numpy as np

from . import _core
from .calibration import Calibration
from .images import Images
from .odometry import DataError, _setting

_PLUMB_BOB = ("plumb_bob", "radtan", "none")  # the models with the coefficients k1, k2, p1, p2, k3
_FOV = (10, 150)  # [degrees]


class Drive(NamedTuple):
    """name: for messages. open: of its images, for every run again. progress: made for a run by name and count."""

    name: str
    open: Callable[[], Images]
    progress: Callable[[str, int], Any]

    def runs(self) -> Callable[[], Iterable[Tuple[np.ndarray, int]]]:
        """With each call the images and stamps of another run; images whose stamps do not increase are left out."""
        number = 0

        def run():
            nonlocal number
            number += 1
            drive, last_stamp = self.open(), -1
            progress = self.progress(f"{self.name}, run {number}", drive.count)
            for image, stamp in drive.images:
                if stamp > last_stamp:
                    yield np.ascontiguousarray(image), stamp
                last_stamp = max(stamp, last_stamp)
                progress.step()
            progress.end()
        return run

    def size(self) -> Tuple[int, int]:
        """(width, height) of the first image."""
        for image, _ in self.open().images:
            return image.shape[::-1]
        raise DataError(f"{self.name}: has no image that can be decoded")


def of_field_of_view(degrees: float, size: Tuple[int, int]) -> Calibration:
    """degrees: horizontal. Raises ValueError."""
    if not _FOV[0] <= degrees <= _FOV[1]:
        raise ValueError(f"--fov is {degrees:g}, it must lie in [{_FOV[0]}, {_FOV[1]}]")
    f = 0.5 * size[0] / math.tan(math.radians(0.5 * degrees))
    return Calibration(size, np.array([[f, 0, (size[0] - 1) / 2], [0, f, (size[1] - 1) / 2], [0, 0, 1]]), "none",
                       np.zeros(5))


def check(calibration: Calibration, name: object) -> None:
    """Raises DataError unless its distortion is that which is estimated."""
    if calibration.model not in _PLUMB_BOB:
        raise DataError(f"{name}: the distortion model is {calibration.model}, calibrate estimates plumb_bob; "
                        "calibrate the camera with that, or rectify the images")
    if calibration.D.size > 5:
        raise DataError(f"{name}: has {calibration.D.size} distortion coefficients, calibrate estimates plumb_bob with "
                        "at most 5")


def output_files(out: pathlib.Path, force: bool) -> List[pathlib.Path]:
    """The file and the image beside it. Raises ValueError or DataError."""
    files = [out, out.with_suffix(".png")]
    if files[0] == files[1]:
        raise ValueError(f"--out {out} is the name of the image beside it, use .yaml")
    for file in files:
        _core.require_new_file(str(file), force)
    return files


def estimate(drives: List[Drive], calibration: Calibration, is_rough: bool, settings: Iterable[Tuple[str, object]],
             files: List[pathlib.Path]) -> None:
    """Prints the result and writes the files. Raises DataError when the drives do not determine the lens."""
    K = calibration.K
    camera = (*calibration.size, *map(float, (K[0, 0], K[1, 1], K[0, 2], K[1, 2])), False)
    distortion = [*map(float, calibration.D), *[0.0] * 5][:5]
    result = _core.calibrate_lens([drive.runs() for drive in drives], camera, distortion, calibration.readout_time,
                                  is_rough, [_setting(name, value) for name, value in settings])
    for drive, report in zip(drives, result["drives"]):
        print("{}: {status}, {keyframes} keyframes, {tracks} tracks, residual rms {rms_before:.3f} -> "
              "{rms_after:.3f} px".format(drive.name, **report))
    if result["reason"]:
        raise DataError(f"the lens is not observable: {result['reason']}")
    print(result["table"], end="")
    if result["confirmed"]:
        print("the drives confirm the calibration: the estimate does not differ significantly from it")
    if not result["converged"]:
        print(f"the estimate still changed in run {result['runs']}; run again with --camera {files[0]}",
              file=sys.stderr)
    is_done, image = cv2.imencode(".png", result["residuals"])
    assert is_done
    for file, content in zip(files, (result["yaml"].encode(), image.tobytes())):
        _core.write_file(str(file), content)
    print(f"written to {files[0]} and {files[1]}")
