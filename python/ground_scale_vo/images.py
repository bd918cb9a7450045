"""Image folders, videos and bags as sequences of grey images with stamps."""

import decimal
import os
import pathlib
import re
from typing import Any, Iterator, NamedTuple, Optional, Tuple

import cv2
import numpy as np

from .odometry import _LAST_STAMP_NS, DataError

# Encodings of sensor_msgs/Image: channels, conversion. OpenCV names Bayer patterns by the second row.
_ENCODINGS = {
    "mono8": (1, None), "8UC1": (1, None), "bgr8": (3, cv2.COLOR_BGR2GRAY), "rgb8": (3, cv2.COLOR_RGB2GRAY),
    "bgra8": (4, cv2.COLOR_BGRA2GRAY), "rgba8": (4, cv2.COLOR_RGBA2GRAY),
    "bayer_rggb8": (1, cv2.COLOR_BayerBG2GRAY), "bayer_bggr8": (1, cv2.COLOR_BayerRG2GRAY),
    "bayer_gbrg8": (1, cv2.COLOR_BayerGR2GRAY), "bayer_grbg8": (1, cv2.COLOR_BayerGB2GRAY)}


class Images(NamedTuple):
    """count: of the images, for a video approximate. images: (height, width) uint8 and stamp [ns].
    topic: of the images of a bag. info_topic, info: the topic camera_info beside it, and its first message,
    None if the bag has none."""

    count: int
    images: Iterator[Tuple[np.ndarray, int]]
    topic: str = ""
    info_topic: str = ""
    info: Any = None


def open_images(path: pathlib.Path, topic: Optional[str]) -> Images:
    """A folder, a bag (*.bag; topic: None if it has one image topic) or a video. Raises DataError."""
    if not path.exists():
        raise DataError(f"{path}: no such file or folder")
    if path.is_dir():
        return _open_folder(path)
    return _open_bag(path, topic) if path.suffix == ".bag" else _open_video(path)


def read_grey(file: pathlib.Path) -> np.ndarray:
    try:
        return _decode(file.read_bytes(), file)
    except OSError as error:
        raise DataError(f"{file}: {error.strerror}") from None


def _decode(data, name):
    image = None
    if data:
        image = cv2.imdecode(np.frombuffer(data, np.uint8),
                             cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
    if image is None:
        raise DataError(f"{name}: cannot be decoded as an image")
    return image


def _open_folder(folder):
    """Images in the order of their names; times.txt has a line [s] for each."""
    files = sorted(file for file in folder.iterdir() if file.suffix.lower() in (".png", ".jpg", ".jpeg"))
    try:
        stamps = [_nanoseconds(word) for word in (folder / "times.txt").read_text().split()]
    except (OSError, ValueError) as error:
        raise DataError(f"{folder / 'times.txt'}: cannot be read ({error})") from None
    wrong = [stamp for stamp in stamps if not 0 <= stamp <= _LAST_STAMP_NS]
    if wrong:
        raise DataError(f"{folder / 'times.txt'}: {wrong[0] / 1e9:.10g} s is not a time since 1970")
    if not files or len(stamps) < len(files):
        raise DataError(f"{folder}: has {len(files)} images and {len(stamps)} stamps in times.txt")
    return Images(len(files), ((read_grey(file), stamp) for file, stamp in zip(files, stamps)))


def _nanoseconds(word):
    """Of seconds as text. A double has no nanoseconds of a time since 1970."""
    try:
        return round(10**9 * decimal.Decimal(word))
    except (ValueError, ArithmeticError):
        raise ValueError(f"{word} is not a time") from None


def _open_video(file):
    """OpenCV rotates the images as the metadata says, and knows the stamp of each: phones record with
    a variable frame rate."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # silent
    capture = cv2.VideoCapture(str(file), cv2.CAP_FFMPEG)
    if not capture.isOpened():
        raise DataError(f"{file}: is not a video that OpenCV can read")

    def images():
        last, interval = 0, 0  # [ms]
        while True:
            is_there, image = capture.read()
            if not is_there:
                return
            stamp = capture.get(cv2.CAP_PROP_POS_MSEC)
            # OpenCV 4.6 reports 0 for the images that the decoder holds at the end of the file.
            stamp = stamp if stamp > 0 else last + interval
            last, interval = stamp, stamp - last
            yield cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), round(1e6 * stamp)
    return Images(int(capture.get(cv2.CAP_PROP_FRAME_COUNT)), images())


def _open_bag(file, topic):
    try:
        import rosbag
    except ImportError:
        raise DataError(f"{file}: the Python module rosbag is missing (Debian: python3-rosbag)") from None
    try:
        bag = rosbag.Bag(str(file))
        all_topics = bag.get_type_and_topic_info().topics
    except Exception as error:  # of many types for a damaged file
        raise DataError(f"{file}: is not a bag that can be read ({error})") from None
    topics = {name: info.message_count for name, info in all_topics.items()
              if info.msg_type in ("sensor_msgs/Image", "sensor_msgs/CompressedImage")}
    if topic is None and len(topics) == 1:
        (topic,) = topics
    if topic not in topics:
        raise DataError(f"{file}: --image must be one of its image topics: {', '.join(topics) or 'none'}")
    info_topic = re.sub("[^/]*(/compressed)?$", "camera_info", topic, count=1)
    images = ((_grey_of(message, topic), message.header.stamp.to_nsec()) for message in _messages(bag, file, topic))
    return Images(topics[topic], images, topic, info_topic, next(_messages(bag, file, info_topic), None))


def _messages(bag, file, topic):
    try:
        for _, message, _ in bag.read_messages([topic]):
            yield message
    except Exception as error:  # of many types for a damaged file
        raise DataError(f"{file}: cannot be read to its end ({error})") from None


def _grey_of(message: Any, topic: str) -> np.ndarray:
    """Of a sensor_msgs/Image or CompressedImage."""
    if hasattr(message, "format"):
        return _decode(message.data, topic)
    data = np.frombuffer(message.data, np.uint8)
    if message.encoding not in _ENCODINGS:
        raise DataError(f"{topic}: the encoding is {message.encoding}, supported are {', '.join(_ENCODINGS)}")
    channels, conversion = _ENCODINGS[message.encoding]
    if len(data) != message.height * message.step or message.step < message.width * channels:
        raise DataError(f"{topic}: an image has {len(data)} bytes, its size and step do not agree")
    rows = data.reshape(message.height, message.step)[:, :message.width * channels]
    if conversion is None:
        return rows
    shape = (message.height, message.width, channels)[:3 if channels > 1 else 2]
    return cv2.cvtColor(np.ascontiguousarray(rows).reshape(shape), conversion)
