"""The command `ground_scale_vo calibrate_height`: the camera's height, from a drive of known length."""

import pathlib
import sys
import tempfile
from typing import Any, Callable, NamedTuple, Optional

import numpy as np

from . import _core, gps
from .odometry import DataError

# Lengths are in camera heights: the odometry runs with a height of 1 m, and all its lengths are proportional to it.
SEGMENT_LENGTH = 12.0  # least length of a segment
SEGMENT_SIGMAS = 40.0  # the same, in standard deviations of a position
MIN_SEGMENTS = 4
OUTLIER_SIGMAS = 4.0
SCALE_CORRELATION = 6.0  # length over which the errors of the scale are equal
METHOD_SIGMA = 0.003  # relative: the bias of the estimated plane, which all segments share
MAX_ERROR = 0.05  # largest relative half width of the 95 % interval
MAX_DEVIATION = 0.15  # largest relative standard deviation of the heights by segments of the same drive


class Estimate(NamedTuple):
    value: float
    error95: float  # half width of the 95 % interval


class Track(gps.Path):
    """The odometry's result for a part of a drive, from its files. p, R: of the poses, in the unit of the camera height;
    normal: N x 3, of the road in camera axes; section: -1 without a metric pose."""

    def __init__(self, folder: pathlib.Path, start_s: float = 0.0, end_s: float = np.inf) -> None:
        table = np.atleast_1d(np.genfromtxt(folder / "scale.csv", delimiter=",", names=True, dtype=None, encoding="ascii"))
        since = table["stamp"] - table["stamp"][0]
        self.image_stamps = table["stamp"]  # of the whole drive
        part = (since >= start_s) & (since <= end_s)
        if not part.any():
            raise DataError("the drive has no image between --from and --to")
        table = table[part]
        poses = np.loadtxt(folder / "poses.txt", ndmin=2)[part].reshape(-1, 3, 4)
        self.R = poses[:, :, :3]
        self.normal = np.stack([table[name] for name in ("nx", "ny", "nz")], -1)
        self.relative_sigma = table["sigma"] / np.maximum(table["scale"], 1e-300)
        relative_height_sigma = table["camera_height_sigma"] / np.maximum(table["camera_height"], 1e-300)
        self.height_sigma = np.minimum(relative_height_sigma, self.relative_sigma)
        self.is_measured = table["status"] == "ok"
        self.is_moving = table["reason"] != "standstill"
        self.is_backfilled = table["backfilled"] == 1
        is_metric = (table["vo_status"] == "tracking") & (table["status"] != "unknown") & ~self.is_backfilled
        is_new = np.append(True, (is_metric[1:] != is_metric[:-1]) | (table["map_id"][1:] != table["map_id"][:-1]))
        super().__init__(table["stamp"], poses[:, :, 3], np.where(is_metric, np.cumsum(is_new), -1))
        if not is_metric.any():
            raise DataError("no frame got a scale")


def mean_of(values: np.ndarray, weights: np.ndarray) -> Estimate:
    """Weighted mean of independent values, with the quantile of Student's t for their number."""
    shares, n = weights / weights.sum(), len(values) - 1
    mean = shares @ values
    sigma = np.sqrt((shares * (values - mean)) @ (shares * (values - mean)) * (n + 1) / n)
    return Estimate(float(mean), float((1.96 + 2.4 / n + 3.8 / n**2) * sigma))


def similarity_scale(source: np.ndarray, target: np.ndarray) -> float:
    """Scale of the least-squares similarity transform (Umeyama 1991) between N x 3 points. Noise in the target does
    not bias it."""
    source, target = source - source.mean(0), target - target.mean(0)
    u, s, vt = np.linalg.svd(target.T @ source)
    s[2] *= np.sign(np.linalg.det(u) * np.linalg.det(vt))
    return float(s.sum() / (source**2).sum())


def require_usual(height: float, question: str) -> None:
    """Raises DataError with the question about the unit of the length; "": any height is accepted."""
    least, largest = _core.USUAL_HEIGHTS
    if question and not least <= height <= largest:
        raise DataError(f"the height would be {height:.3g} m, on a road vehicle it is {least:g} to {largest:g} m: {question} "
                        "If so, --set unusual_height=true")


class Positions(NamedTuple):
    """Of a point of the vehicle, along the drive. stamp: None: of the images."""

    name: str
    stamp: Optional[np.ndarray]
    p: np.ndarray  # N x 3 [m]
    sigma: float  # of a position relative to its neighbours [m]
    question: str  # of require_usual()


def height_from_positions(track: Track, stamps: np.ndarray, positions: Positions) -> Estimate:
    """The height from positions along the drive, whose stamps are by the clock of the track: the mean over segments."""
    known, sigma_m = positions.p, positions.sigma
    p, sections = track.at(stamps)
    heights, lengths = [], []
    start = 0
    for i in range(len(stamps)):
        if sections[i] != sections[start] or sections[i] < 0:
            start = i
            continue
        length = np.linalg.norm(p[i] - p[start])
        if length < SEGMENT_LENGTH or i < start + 2 or np.linalg.norm(known[i] - known[start]) < SEGMENT_SIGMAS * sigma_m:
            continue
        inside = (track.stamp >= stamps[start]) & (track.stamp <= stamps[i]) & track.is_moving
        if track.is_measured[inside].sum() >= 0.5 * inside.sum():
            heights.append(similarity_scale(p[start:i + 1], known[start:i + 1]))
            lengths.append(length)
        start = i
    values, weights = np.array(heights), np.array(lengths)
    is_used = np.ones(len(values), bool)
    if heights:
        deviations = np.abs(values - np.median(values))
        is_used = deviations <= OUTLIER_SIGMAS * max(1.4826 * np.median(deviations), METHOD_SIGMA * np.median(values))
    print(f"{is_used.sum()} of {len(values)} segments")
    if is_used.sum() < MIN_SEGMENTS:
        assumed = ("" if sigma_m != gps.DEFAULT_SIGMA else
                   f"; the fixes state no standard deviation, with the assumed {sigma_m:g} m (column sigma) a segment is "
                   f"{SEGMENT_SIGMAS * sigma_m:g} m long")
        inside = sections == np.argmax(np.bincount(sections[sections >= 0], minlength=1))
        if inside.any() and np.ptp(p[inside], axis=0).max() > SEGMENT_LENGTH:
            require_usual(similarity_scale(p[inside], known[inside]), positions.question)
        raise DataError(f"{is_used.sum()} segments of the drive can be compared, {MIN_SEGMENTS} are needed: it is too "
                        f"short, or tracking or positions have too many gaps{assumed}")
    deviation = values[is_used].std(ddof=1) / values[is_used].mean()
    if deviation > MAX_DEVIATION:
        raise DataError("the positions do not follow the motion of the images: the heights by its segments have a standard "
                        f"deviation of {100 * deviation:.0f} %; are they of this drive, and by its clock?")
    return mean_of(values[is_used], weights[is_used])


def height_from_length(track: Track, length_m: float, sigma_m: float) -> Estimate:
    """The height from the length of the whole path; the error is the reported sigma of the scale."""
    first = np.argmax(track.section >= 0)
    at_start = np.argmax(np.any(track.p != track.p[0], axis=1)) - 1
    if first > 0 and track.is_backfilled[0] and at_start > 0:
        raise DataError(f"the distance travelled before frame {at_start}, where the odometry started, is not known")
    lost = np.flatnonzero(track.section[first:] != track.section[first])
    if len(lost) or not (first == 0 or track.is_backfilled[:first].all()):
        raise DataError(f"the odometry was lost at or before frame {first + lost[0] if len(lost) else first} of "
                        f"{len(track.stamp)}, so the length of the whole drive cannot be compared")
    length, corner = 0.0, track.p[0]
    for p in track.p:  # shorter steps than half a camera height would add the noise of the positions
        step = np.linalg.norm(p - corner)
        if step >= 0.5 or p is track.p[-1]:
            length, corner = length + step, p
    if not length > 0:
        raise DataError("the camera did not move according to the odometry")
    scale_sigma = np.sqrt((track.relative_sigma[first:]**2).mean() * SCALE_CORRELATION / max(length, SCALE_CORRELATION))
    return Estimate(length_m / length, 1.96 * float(np.hypot(scale_sigma, sigma_m / length_m)) * length_m / length)


def mounting_text(track: Track, height: float) -> str:
    """Comments with pitch and roll of the camera, and its transform. Their means over segments hide the vehicle's."""
    moved = np.append(0, np.linalg.norm(np.diff(track.p, axis=0), axis=1))
    segment = (np.cumsum(moved) / SEGMENT_LENGTH).astype(int)
    angles = np.array([[_core.pitch_of(n), _core.roll_of(n)] for n in track.normal]).T
    counts = np.bincount(segment, track.is_measured)
    if (counts > 0).sum() < 3:
        return "# Its pitch and roll are not known: the drive is too short, or the road was measured too rarely.\n"
    pitch, roll = (mean_of(np.bincount(segment, angle * track.is_measured)[counts > 0] / counts[counts > 0],
                           counts[counts > 0]) for angle in angles)
    return str(_core.mounting_comments(height, *pitch, *roll))


def read_trajectory(file: pathlib.Path, images: int) -> Positions:
    """A file of TUM, or of KITTI with a line for each image."""
    try:
        rows = np.loadtxt(file, ndmin=2)
    except (OSError, ValueError) as error:
        raise DataError(f"{file}: cannot be read ({error})") from None
    if rows.shape[1] not in (8, 12) or not np.isfinite(rows).all():
        raise DataError(f"{file}: its lines are not 8 (TUM) or 12 (KITTI) finite numbers")
    if rows.shape[1] == 12 and len(rows) != images:
        raise DataError(f"{file}: has {len(rows)} poses without stamps for {images} images")
    name, question = f"trajectory {file}", "are its positions in metres?"
    if rows.shape[1] == 12:
        return Positions(name, None, rows[:, 3::4], 0.0, question)
    if not (np.diff(rows[:, 0]) > 0).all():
        raise DataError(f"{file}: its stamps do not increase")
    return Positions(name, rows[:, 0], rows[:, 1:4], 0.0, question)


def read_fixes(source: str, drive: str) -> Positions:
    fixes = gps.read(source, drive)
    print(fixes)
    return Positions(fixes.name, fixes.stamp, fixes.positions(), float(np.median(fixes.sigma_h)),
                     "are the fixes in degrees, and of this drive?")


def height_by_clock(track: Track, known: Positions, offset: float) -> Estimate:
    """height_from_positions(); offset: to add to the stamps [s], of which the speeds may show a rest."""
    if known.stamp is None:
        return height_from_positions(track, track.image_stamps, known)
    stamps = known.stamp + offset
    path = gps.Path(stamps, known.p)
    return height_from_positions(track, gps.clock_checked(track, path, known.sigma, known.name, offset), known)


def estimate_height(open_reader: Callable[[], Any], name: str, drive: str, arguments: Any) -> None:
    """Runs the odometry over the drive and writes arguments.out. open_reader(): its images."""
    _core.require_new_file(str(arguments.out), arguments.force)
    images = open_reader().count
    known, question = None, "is --length in metres?"
    if arguments.gps:
        known = read_fixes(arguments.gps, drive)
    elif arguments.trajectory:
        known = read_trajectory(arguments.trajectory, images)
    if "unusual_height=true" in arguments.set:
        known, question = known and known._replace(question=""), ""
    with tempfile.TemporaryDirectory() as work:
        result = _core.run(open_reader, name, 1.0, ["camera_height_sigma=0", *arguments.set], [], 0.0, work, False, False, False)
        for sentence in result["warnings"]:
            print(f"{name}: {sentence}", file=sys.stderr)
        print(f"{name}, in camera heights instead of metres: {result['summary']}")
        is_whole = arguments.start == 0 and arguments.end == float("inf")
        if result["failure"] and is_whole:
            raise DataError(result["failure"])
        track = Track(pathlib.Path(work), arguments.start, arguments.end)
    if known:
        source, height = f"the {known.name}", height_by_clock(track, known, arguments.gps_offset)
    else:
        source = f"a drive of {arguments.length:g} m, known to {arguments.length_sigma:g} m"
        height = height_from_length(track, arguments.length, arguments.length_sigma)
    require_usual(height.value, known.question if known else question)
    height = Estimate(height.value, float(np.hypot(height.error95, 1.96 * METHOD_SIGMA * height.value)))
    error = height.error95 / height.value
    if error > MAX_ERROR:
        raise DataError(f"the height would be {height.value:.2f} m, but uncertain by {100 * error:.1f} % (95 %), more than "
                        f"{100 * MAX_ERROR:.1f} %: drive farther, or measure the length better")
    text = _core.height_yaml(source, *height) + mounting_text(track, height.value)
    print(text, end="")
    _core.write_file(str(arguments.out), text)
    print(f"written to {arguments.out}")
