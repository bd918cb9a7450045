from typing import Any, Callable, Dict, Iterable, Iterator, List, Optional, Tuple

from numpy import ndarray

_Camera = Tuple[int, int, float, float, float, float, bool]

class DataError(ValueError):
    """A file or folder cannot be used; the text names it."""

class Odometry:
    def __init__(self, camera: _Camera, camera_height: float, settings: List[str],
                 mask: Optional[ndarray], record: bool) -> None: ...
    def process(self, image: ndarray, stamp_ns: int) -> Dict[str, Any]: ...
    def poses(self) -> ndarray: ...
    def metrics(self, ground_truth: Optional[ndarray], heights: Optional[ndarray]) -> str: ...
    def write(self, folder: str, ground_truth: Optional[ndarray], heights: Optional[ndarray]) -> None: ...

class KittiSequence:
    def __init__(self, folder: str) -> None: ...
    def name(self) -> str: ...
    def camera(self) -> _Camera: ...
    def stamps(self) -> List[int]: ...
    def ground_truth(self) -> ndarray: ...
    def ground_truth_heights(self) -> List[float]: ...
    def __iter__(self) -> Iterator[Tuple[ndarray, int]]: ...

def calibrate_lens(drives: List[Callable[[], Iterable[Tuple[ndarray, int]]]], camera: _Camera, distortion: List[float],
                   readout_time: float, is_rough: bool, settings: List[str]) -> Dict[str, Any]:
    """Of drives that can be read several times. distortion: k1, k2, p1, p2, k3. is_rough: the camera is from a
    field of view that may be wrong by 15 %.

    The result: reason (why the lens is not observable, else empty); drives, for each one status, keyframes, tracks,
    rms_before, rms_after [px]; runs; converged; confirmed; table and yaml (text); residuals: (rows, columns, 3) uint8, missing
    without an observable lens."""

def require_new_file(file: str, force: bool) -> None:
    """Raises DataError."""

def write_file(file: str, content: bytes) -> None:
    """The file is complete or missing. Raises DataError."""
