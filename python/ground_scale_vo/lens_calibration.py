"""Estimates the lens of a camera from drives: ground_scale_vo calibrate."""

import pathlib
import sys
from typing import Any, Callable, List

from . import _core
from .odometry import DataError


def output_files(out: pathlib.Path, force: bool) -> List[pathlib.Path]:
    """The file and the image beside it. Raises ValueError or DataError."""
    files = [out, out.with_suffix(".png")]
    if files[0] == files[1]:
        raise ValueError(f"--out {out} is the name of the image beside it, use .yaml")
    for file in files:
        _core.require_new_file(str(file), force)
    return files


def estimate(drives: List[Callable[[], Any]], names: List[str], is_rough: bool, settings: List[str],
             files: List[pathlib.Path]) -> None:
    """Prints the result and writes the files. drives: each call opens a drive again. Raises DataError when the drives
    do not determine the lens."""
    result = _core.calibrate_lens(drives, names, is_rough, settings)
    for name, report in zip(names, result["drives"]):
        print("{}: {status}, {keyframes} keyframes, {tracks} tracks, residual rms {rms_before:.3f} -> "
              "{rms_after:.3f} px".format(name, **report))
    if result["reason"]:
        raise DataError(f"the lens is not observable: {result['reason']}")
    print(result["table"], end="")
    if result["confirmed"]:
        print("the drives confirm the calibration: the estimate does not differ significantly from it")
    if not result["converged"]:
        print(f"the estimate still changed in run {result['runs']}; run again with --camera {files[0]}",
              file=sys.stderr)
    for file, content in zip(files, (result["yaml"].encode(), result["residuals"])):
        _core.write_file(str(file), content)
    print(f"written to {files[0]} and {files[1]}")
