"""The images and GPS fixes of a bag, read with the Python module rosbag."""

import re
from typing import Any, Iterator, List, Optional, Tuple

from . import _core
from ._core import DataError

_IMAGE_TYPES = ("sensor_msgs/Image", "sensor_msgs/CompressedImage")
_SPEED_TYPES = ("nav_msgs/Odometry", "geometry_msgs/TwistStamped", "geometry_msgs/TwistWithCovarianceStamped")
_NUMBER_TYPES = ("std_msgs/Float32", "std_msgs/Float64")  # without stamp and unit


def open_bag(file: str, topic: Optional[str], info: Optional[str], rectified: bool, camera: str, fov: float, mask: str,
             fps: float) -> _core.Reader:
    """topic: of the images; None: the bag has one. info: of camera_info; None: beside the images. camera, fov: in place of
    its camera_info. Raises DataError."""
    bag, topics = _open(file)
    images = [name for name, info in topics.items() if info.msg_type in _IMAGE_TYPES]
    name = _image_topic(file, topics, images, topic)
    raw = re.sub("/compressed$", "", name)
    info_topic = info or raw[:raw.rfind("/") + 1] + "camera_info"
    all_infos = [other for other, of_topic in topics.items() if of_topic.msg_type == "sensor_msgs/CameraInfo"]
    infos = [] if camera or fov else [other for other in all_infos if _bare(other) == _bare(info_topic)]
    if not infos and not camera and not fov:
        others = f"--camera-info TOPIC ({', '.join(all_infos)}) or " if all_infos else ""
        raise (DataError if info else ValueError)(f"{others}--camera is missing; {file} has no {info_topic}")
    return _core.open_messages(name, topics[name].message_count, _fields(bag, file, name, *infos),
                               lambda: _span(bag, file, name), info_topic,
                               _fields(bag, file, *infos) if infos else (), rectified, camera, fov, mask, fps)


def require_camera_info(files: List[str], image: str, infos: List[str], rectified: bool) -> None:
    """Raises DataError when no message on the topics infos, the same one with and without a slash, describes the images."""
    messages = (message for file in files for message in _fields(_open(file)[0], file, *infos))
    _core.require_camera_info(messages, infos[0], image, rectified)


def fix_messages(file: str, topic: Optional[str]) -> Iterator[Any]:
    """The messages sensor_msgs/NavSatFix of a topic; None: the bag has one. Raises DataError."""
    bag, topics = _open(file)
    names = [name for name, info in topics.items() if info.msg_type == "sensor_msgs/NavSatFix"
             and (topic is None or _bare(name) == _bare(topic))]
    if not names or (topic is None and len(names) > 1):
        raise DataError(f"{file}: has no fixes on {topic}; it holds {', '.join(sorted(topics)) or 'nothing'}" if topic else
                        f"{file}: of its topics one must have fixes, not {', '.join(names) or 'none'}")
    return (message for name in names for message in _messages(bag, file, name))


def speeds(file: str, topic: str, unit: str) -> Tuple[List[_core.SpeedSample], str]:
    """The speeds of a topic, and a sentence about those that cannot be used, or "". unit: of the speeds; "": that of the
    type. Raises DataError."""
    bag, topics = _open(file)
    names = [name for name in topics if _bare(name) == _bare(topic)]
    types = {topics[name].msg_type for name in names}
    if not names or not types <= {*_SPEED_TYPES, *_NUMBER_TYPES}:
        candidates = sorted(name for name, info in topics.items() if info.msg_type in _SPEED_TYPES + _NUMBER_TYPES)
        raise DataError(f"{file}: {topic} {'holds ' + ', '.join(types) if names else 'is no topic of it'}; its topics with "
                        f"a speed are {', '.join(candidates) or 'none'}")
    if not unit and types & {*_NUMBER_TYPES}:
        raise DataError(f"{file}: {topic} holds {', '.join(types)}, whose unit is not known: --speed-unit is missing")
    velocities = [_velocity(message, arrival) for name in names for message, arrival in _stamped(bag, file, name)]
    return _core.read_velocities(velocities, unit or "mps", topic)


def _velocity(message, arrival):
    if not hasattr(message, "header"):
        return arrival.to_nsec(), (message.data, 0.0, 0.0), 0.0
    twist, variance = message.twist, 0.0
    if hasattr(twist, "covariance"):
        twist, variance = twist.twist, twist.covariance[0]
    return message.header.stamp.to_nsec(), (twist.linear.x, twist.linear.y, twist.linear.z), variance


def _bare(topic):
    return topic.lstrip("/")


def _image_topic(file, topics, images, topic):
    if topic is None:  # compressed ones beside the same images are left out
        images = [name for name in images if name[:name.rfind("/")] not in images]
        found = images if len(images) == 1 else []
    else:
        found = [name for wanted in (topic, topic + "/compressed") for name in images if _bare(name) == _bare(wanted)]
    if not found:
        others = [f"; {name} holds {info.msg_type}" for name, info in topics.items() if topic and _bare(name) == _bare(topic)]
        raise DataError(f"{file}: --image must be one of its image topics: {', '.join(images) or 'none'}{''.join(others)}")
    return found[0]


def _open(file):
    try:
        import rosbag
    except ImportError:
        raise DataError(f"{file}: the Python module rosbag is missing (Debian: python3-rosbag)") from None
    try:
        bag = rosbag.Bag(file)
        return bag, bag.get_type_and_topic_info().topics
    except FileNotFoundError:
        raise DataError(f"{file}: no such file or folder") from None
    except Exception as error:  # of many types for a damaged file
        raise DataError(f"{file}: is not a bag that can be read ({error or type(error).__name__}); `rosbag reindex` "
                        "repairs one whose recording was interrupted") from None


def _fields(bag, file, *topics) -> Iterator[Any]:
    """For _core.open_messages: images as tuples, camera_info as dictionaries."""
    for message in _messages(bag, file, *topics):
        try:
            yield _camera_info(message) if message._type == "sensor_msgs/CameraInfo" else _image(message)
        except AttributeError:
            raise DataError(f"{file}: its {message._type} has other fields than those of ROS 1 ("
                            f"{', '.join(message.__slots__) or 'none'}): convert it, for example with rosbags-convert, "
                            "or run rosrun rosbag fix_msg_defs.py") from None


def _span(bag, file, topic):
    """The stamps of the first and the last image [ns]; only the last second is read."""
    import genpy
    for start_s in (max(bag.get_end_time() - 1.0, 0.0), 0.0):
        last = [message for message, _ in _stamped(bag, file, topic, start=genpy.Time.from_sec(start_s))][-1:]
        if last:
            return tuple(message.header.stamp.to_nsec() for message in (next(_messages(bag, file, topic)), *last))
    return 0, 0


def _messages(bag, file, *topics) -> Iterator[Any]:
    return (message for message, _ in _stamped(bag, file, *topics))


def _stamped(bag, file, *topics, start=None) -> Iterator[Any]:
    try:
        for _, message, arrival in bag.read_messages(topics, start_time=start):
            yield message, arrival
    except Exception as error:  # of many types for a damaged file
        raise DataError(f"{file}: cannot be read to its end ({error})") from None


def _image(message):
    stamp = message.header.stamp.to_nsec()
    if hasattr(message, "format"):
        return stamp, message.format, True, False, 0, 0, 0, bytes(message.data), message.header.frame_id
    return (stamp, message.encoding, False, bool(message.is_bigendian), message.height, message.width, message.step,
            bytes(message.data), message.header.frame_id)


def _camera_info(message):
    names = ("height", "width", "distortion_model", "D", "K", "R", "P", "binning_x", "binning_y")
    roi = message.roi
    return {**{name: getattr(message, name) for name in names},
            "roi": (roi.x_offset, roi.y_offset, roi.height, roi.width)}
