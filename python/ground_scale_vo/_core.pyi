from typing import Any, Callable, Dict, Iterable, Iterator, List, Optional, Tuple

from numpy import ndarray

_Camera = Tuple[int, int, float, float, float, float, bool]

class DataError(ValueError):
    """A file or folder cannot be used; the text names it."""

class Odometry:
    def __init__(self, camera: _Camera, camera_height: float, settings: List[str],
                 mask: Optional[ndarray], record: bool) -> None: ...
    def process(self, image: ndarray, stamp_ns: int) -> Dict[str, Any]: ...
    def add_speed(self, stamp_ns: int, speed: float, sigma: float) -> None: ...
    def poses(self) -> ndarray: ...
    def metrics(self, ground_truth: Optional[ndarray], heights: Optional[ndarray]) -> str: ...
    def write(self, folder: str, ground_truth: Optional[ndarray], heights: Optional[ndarray]) -> None: ...

class Reader:
    """A drive that is read once. camera, mask: of the rectified images."""

    count: int
    camera: _Camera
    mask: Optional[ndarray]
    readout_time: float
    ground_truth: ndarray
    ground_truth_heights: List[float]
    def next(self) -> Optional[Tuple[ndarray, int]]:
        """The next image that can be used, rectified, and its stamp [ns]; None after the last one."""
    def warnings(self) -> List[str]: ...
    def failure(self) -> str: ...

def open_files(path: str, camera_file: str, fov_deg: float, unrectified: bool, mask_file: str,
               fps: float) -> Reader: ...
def open_messages(topic: str, count: int, messages: Iterator[Tuple[Any, ...]], info_topic: str,
                  infos: Iterable[Dict[str, Any]], is_rectified: bool, camera_file: str, fov_deg: float,
                  mask_file: str, fps: float) -> Reader:
    """messages: (stamp_ns, encoding or format, is_compressed, is_bigendian, height, width, step, data); infos: the
    fields of CameraInfo, of which the first valid one is used."""

def height_yaml(source: str, height: float, error95: float) -> str: ...
def mounting_comments(height: float, pitch: float, pitch95: float, roll: float, roll95: float) -> str:
    """Angles in rad."""
def pitch_of(normal: ndarray) -> float: ...
def roll_of(normal: ndarray) -> float: ...

def camera_info_topic_of(image_topic: str) -> str: ...
def result_name(drive: str) -> str: ...
def run(reader: Reader, name: str, camera_height: float, settings: List[str], speed_file: str,
        folder: str, is_strict: bool) -> Dict[str, Any]:
    """Runs the odometry, shows the progress, writes the results. The result: warnings, summary, failure, status."""

def calibrate_lens(drives: List[Callable[[], Reader]], names: List[str], is_rough: bool,
                   settings: List[str]) -> Dict[str, Any]:
    """Of drives that can be opened several times; the first one has the calibration. is_rough: it is from a field of
    view that may be wrong by 15 %.

    The result: reason (why the lens is not observable, else empty); drives, for each one status, keyframes, tracks,
    rms_before, rms_after [px]; runs; converged; confirmed; table and yaml (text); residuals: a PNG image, missing
    without an observable lens."""

def require_new_file(file: str, force: bool) -> None:
    """Raises DataError."""

def write_file(file: str, content: bytes) -> None:
    """The file is complete or missing. Raises DataError."""
