"""Metric monocular visual odometry for a camera of known height above the road.

Images are grey and rectified. Camera axes: x right, y down, z forward. An argument that cannot be
used raises TypeError or ValueError with a sentence that names it.
"""

import importlib
import pkgutil
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .odometry import Camera, DataError, Drive, MetricOdometry, Record, Result, open_drive

__all__ = ["Camera", "DataError", "Drive", "MetricOdometry", "Record", "Result", "open_drive"]

# The ROS messages, ground_scale_vo.msg, are in another folder of this name, with a copy of this file. Whichever
# of the two comes first in sys.path finds the modules of both.
__path__ = pkgutil.extend_path(__path__, __name__)


def __getattr__(name: str) -> Any:
    """Loads the odometry when it is used first: ROS nodes need only the messages."""
    if name in __all__:
        return getattr(importlib.import_module(".odometry", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
