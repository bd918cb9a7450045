"""GPS fixes of a bag or a GPX, NMEA or CSV file, in metres and by the clock of the images."""

import csv
import datetime
import importlib
import io
import math
import pathlib
import re
from typing import Any, Dict, Iterable, Iterator, NamedTuple, Optional, Tuple

import numpy as np

from . import _core, bags
from ._core import DataError

DEFAULT_SIGMA = 2.5  # [m] of a fix relative to its neighbours where the receiver states none; times its HDOP
LEAST_SIGMA, LARGEST_SIGMA = 1e-3, 1e3  # [m] a placeholder, no fix
LARGEST_SPEED, LEAST_JUMP = 100.0, 50.0  # [m/s], [m] fixes farther apart contradict each other
LARGEST_OFFSET = 0.3  # [s] between the clocks of positions and images
OFFSET_SIGMAS = 4.0  # an offset of fewer standard deviations is none
SPEED_SIGMA = 0.5  # [m/s] of the speeds that are compared
LATEST_STAMP = 2**32  # [s] larger stamps are in ms, us or ns
COLUMNS = {"stamp": ("headerstamp", "stamp", "timestamp", "datetime", "utc", "time"), "latitude": ("latitude", "lat"),
           "longitude": ("longitude", "lon", "lng", "long"), "altitude": ("altitude", "alt", "elevation", "ele", "height"),
           "sigma": ("sigma", "accuracy"), "status": ("statusstatus", "status")}


class Path:
    """stamp [s], increasing; p: N x 3 positions; section: the same number along an uninterrupted part, -1: none. Without it a
    gap ends a part."""

    def __init__(self, stamp: np.ndarray, p: np.ndarray, section: Optional[np.ndarray] = None) -> None:
        if section is None:
            steps = np.diff(stamp)
            section = np.append(0, np.cumsum(steps > max(2.0, 3 * float(np.median(steps))))) if len(steps) else np.zeros(1, int)
        self.stamp, self.p, self.section = stamp, p, section

    def at(self, stamps: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """The positions at these stamps, linear between two of a section, and the sections; -1: none."""
        after = np.clip(np.searchsorted(self.stamp, stamps), 1, len(self.stamp) - 1)
        sections = np.where(self.section[after] == self.section[after - 1], self.section[after], -1)
        sections[(stamps < self.stamp[0]) | (stamps > self.stamp[-1])] = -1
        return np.stack([np.interp(stamps, self.stamp, axis) for axis in self.p.T], -1), sections

    def speeds(self, window: float) -> Tuple[np.ndarray, np.ndarray]:
        """Stamps, and the distance from half a window [s] before to half a window after each, divided by the window."""
        (before, first), (after, last) = self.at(self.stamp - window / 2), self.at(self.stamp + window / 2)
        is_known = (first == last) & (first >= 0)
        return self.stamp[is_known], np.linalg.norm(after - before, axis=1)[is_known] / window


class LocalFrame:
    """Axes east, north and up [m] at a place of WGS 84."""

    def __init__(self, latitude: float, longitude: float, altitude: float) -> None:
        self._origin = ecef(latitude, longitude, altitude)
        (sin_lat, sin_lon), (cos_lat, cos_lon) = (f(np.radians([latitude, longitude])) for f in (np.sin, np.cos))
        self._axes = np.array([[-sin_lon, cos_lon, 0], [-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat],
                               [cos_lat * cos_lon, cos_lat * sin_lon, sin_lat]])

    def positions(self, latitude: np.ndarray, longitude: np.ndarray, altitude: np.ndarray) -> np.ndarray:
        """N x 3."""
        return (ecef(latitude, longitude, altitude) - self._origin) @ self._axes.T

    def wgs84(self, positions: np.ndarray) -> np.ndarray:
        """N x 3: latitude and longitude [degrees] and altitude [m] of N x 3 positions."""
        return np.stack(_transformer("EPSG:4978", "EPSG:4979").transform(*(positions @ self._axes + self._origin).T), -1)


class Fixes(NamedTuple):
    """Fixes that can be used. left_out: how many are not, by reason."""

    name: str
    stamp: np.ndarray  # [s], increasing
    latitude: np.ndarray  # [degrees], WGS 84
    longitude: np.ndarray
    altitude: np.ndarray  # [m]
    sigma_h: np.ndarray  # standard deviation of east and of north relative to the neighbours [m]
    sigma_v: np.ndarray  # the same upwards
    left_out: Dict[str, int]

    def frame(self) -> LocalFrame:
        """At the fix in the middle of all."""
        p = ecef(self.latitude, self.longitude, self.altitude)
        middle = np.argmin(np.linalg.norm(p - np.median(p, axis=0), axis=1))
        return LocalFrame(self.latitude[middle], self.longitude[middle], self.altitude[middle])

    def positions(self) -> np.ndarray:
        """N x 3, in frame()."""
        return self.frame().positions(self.latitude, self.longitude, self.altitude)

    def __str__(self) -> str:
        counts = _counts(self.left_out)
        return f"{self.name}: {len(self.stamp)} are used" + (f", left out are {counts}" if counts else "")


class _Row(NamedTuple):
    """A fix as it comes; NaN: not known."""

    stamp: float
    latitude: float
    longitude: float
    altitude: float = math.nan
    sigma_h: float = math.nan
    sigma_v: float = math.nan
    is_fix: bool = True


def read(source: str, drive: str) -> Fixes:
    """source: a file; FILE.bag, which has one topic of fixes; FILE.bag:TOPIC; or a topic of the drive, a bag."""
    bag = re.fullmatch(r"(.+\.bag)(?::(.+))?", source)
    if not bag and drive.endswith(".bag") and not pathlib.Path(source).suffix:
        bag = re.fullmatch("(.+)\0(.+)", f"{drive}\0{source}")
    if bag:
        return _fixes(f"fixes on {bag[2] or bag[1]}", _bag_rows(bags.fix_messages(bag[1], bag[2])))
    try:
        text = pathlib.Path(source).read_text(encoding="utf-8-sig", errors="replace")
    except OSError as error:
        raise DataError(f"{source}: {error.strerror}; fixes come from a GPX, NMEA or CSV file, FILE.bag:TOPIC or a topic of "
                        "the drive's bag") from None
    is_nmea = re.search(r"\$[A-Z]{2}(RMC|GGA),", text)
    rows = _gpx_rows if text.lstrip().startswith("<") else _nmea_rows if is_nmea else _csv_rows
    return _fixes(f"fixes of {source}", rows(source, text))


def ecef(latitude: Any, longitude: Any, altitude: Any) -> np.ndarray:
    """N x 3, or 3, geocentric [m]."""
    return np.stack(_transformer("EPSG:4979", "EPSG:4978").transform(latitude, longitude, altitude), -1)


def _transformer(source: str, target: str) -> Any:
    return library("pyproj").Transformer.from_crs(source, target)


def library(module: str, package: Optional[str] = None) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError:
        raise DataError(f"the Python module {module} is missing (Debian: {package or f'python3-{module}'})") from None


def _bag_rows(messages: Iterable[Any]) -> Iterator[_Row]:
    for fix in messages:
        variances = np.array(fix.position_covariance)[[0, 4, 8]]
        sigmas = np.sqrt(np.abs(variances)) if fix.position_covariance_type != 0 and variances.min() >= 0 else [math.nan] * 3
        yield _Row(fix.header.stamp.to_sec() or math.nan, fix.latitude, fix.longitude, fix.altitude,
                   math.hypot(*sigmas[:2]) / math.sqrt(2), sigmas[2], fix.status.status >= 0)


def _gpx_rows(file: str, text: str) -> Iterator[_Row]:
    gpxpy = library("gpxpy")
    try:
        gpx = gpxpy.parse(text)
    except gpxpy.gpx.GPXException as error:
        raise DataError(f"{file}: is no GPX file that can be read ({error})") from None
    for point in gpx.walk(only_points=True):
        sigma = _number(point.horizontal_dilution) * DEFAULT_SIGMA
        yield _Row(_utc(point.time), point.latitude, point.longitude, _number(point.elevation), sigma, math.nan,
                   point.type_of_gpx_fix != "none")


def _nmea_rows(file: str, text: str) -> Iterator[_Row]:
    """Of each time, GGA (or RMC) and GST. GGA has no date: that of the RMC before, or after, and the next one at midnight."""
    nmea = library("pynmea2", "python3-nmea2")
    epochs = []
    for sentence in re.findall(r"\$[A-Z]{2}(?:RMC|GGA|GST),[^\r\n*$]*\*[0-9A-Fa-f]{2}", text):
        try:
            parsed = nmea.parse(sentence, check=True)
        except nmea.ParseError:
            yield _Row(math.nan, math.nan, math.nan)
            continue
        if not epochs or epochs[-1]["time"] != parsed.timestamp:
            epochs.append({"time": parsed.timestamp})
        epochs[-1][parsed.sentence_type] = parsed
    dates = [epoch["RMC"].datestamp for epoch in epochs if "RMC" in epoch and isinstance(epoch["RMC"].datestamp, datetime.date)]
    date, last = (dates or [datetime.date(1970, 1, 1)])[0], None
    for epoch in epochs:
        time, gga, rmc, gst = (epoch.get(name) for name in ("time", "GGA", "RMC", "GST"))
        if not gga and not rmc:
            continue
        if rmc and isinstance(rmc.datestamp, datetime.date):
            date = rmc.datestamp
        elif last and time and time < last:
            date += datetime.timedelta(days=1)
        last = time
        stamp = _utc(datetime.datetime.combine(date, time)) if isinstance(time, datetime.time) else math.nan
        is_fix = gga.gps_qual not in (0, 6, 7) if gga else rmc.status == "A"  # 6: dead reckoning, 7: typed in
        place = (gga or rmc).latitude, (gga or rmc).longitude
        sigma_h, sigma_v = (_number(gga and gga.horizontal_dil) * DEFAULT_SIGMA, math.nan)
        if gst:
            sigma_h, sigma_v = _number(gst.std_dev_latitude), _number(gst.std_dev_altitude)
        yield _Row(stamp, *place, _number(gga and gga.altitude) + (_number(gga and gga.geo_sep, 0.0)), sigma_h, sigma_v, is_fix)


def _csv_rows(file: str, text: str) -> Iterator[_Row]:
    """Columns as of COLUMNS, or of `rostopic echo -p`; times in s, ms, us or ns, or ISO 8601."""
    heading = text.partition("\n")[0]
    table = csv.reader(io.StringIO(text), delimiter=max(",;\t", key=heading.count))
    names = [re.sub(r"^%?(field\.)?|[\[(].*|[^a-z]", "", name.lower()) for name in next(table, [])]
    column = {key: next((names.index(alias) for alias in aliases if alias in names), None) for key, aliases in COLUMNS.items()}
    if None in (column["stamp"], column["latitude"], column["longitude"]):
        raise DataError(f"{file}: is no GPX or NMEA file, and no CSV with a heading of the columns stamp, latitude and longitude")
    for cells in table:
        def value(key, cells=cells, read=_number):
            return read(cells[column[key]].strip()) if column[key] is not None and column[key] < len(cells) else math.nan
        try:
            yield _Row(value("stamp", read=_stamp), value("latitude"), value("longitude"), value("altitude"), value("sigma"),
                       math.nan, not value("status") < 0)
        except ValueError as error:
            raise DataError(f"{file}:{table.line_num}: {error}") from None


def _number(value: Any, default: float = math.nan) -> float:
    return default if value in (None, "") else float(value)


def _stamp(text: str) -> float:
    try:
        stamp = _number(text)
    except ValueError:
        return _utc(datetime.datetime.fromisoformat(re.sub(r"[zZ]$", "", text).replace("/", "-")))
    while stamp > LATEST_STAMP:
        stamp /= 1000
    return stamp


def _utc(time: Optional[datetime.datetime]) -> float:
    """Without a time zone: UTC."""
    return math.nan if time is None else (time if time.tzinfo else time.replace(tzinfo=datetime.timezone.utc)).timestamp()


def _fixes(name: str, rows: Iterable[_Row]) -> Fixes:
    """Sorts out what is no fix."""
    table, left_out = np.array([tuple(row) for row in rows], float).reshape(-1, len(_Row._fields)), {}

    def keep(is_good, reason):
        nonlocal table
        left_out[reason] = int((~is_good).sum())
        table = table[is_good]

    keep(np.isfinite(table[:, 0]), "without a valid time")
    keep((table[:, 6] > 0) & ~(table[:, 4] > LARGEST_SIGMA), "without a fix")
    keep((np.abs(table[:, 1]) <= 90) & (np.abs(table[:, 2]) <= 180), "without a position")
    keep((table[:, 1:3] != 0).any(1), "at 0, 0")
    keep(table[:, 0] > np.maximum.accumulate(np.append(-np.inf, table[:-1, 0])), "not later than the one before")
    is_known = np.isfinite(table[:, 3])
    table[~is_known, 3], table[~is_known, 5] = np.median(table[is_known, 3]) if is_known.any() else 0.0, LARGEST_SIGMA
    if len(table):
        keep(_consistent(table[:, 0], ecef(*table[:, 1:4].T)), "far from the others")
    if not len(table):
        raise DataError(f"{name}: none can be used, of {sum(left_out.values())} are {_counts(left_out)}" if sum(left_out.values())
                        else f"{name}: there are none")
    sigmas = np.where(table[:, 4:6] >= LEAST_SIGMA, table[:, 4:6], [DEFAULT_SIGMA, 2 * DEFAULT_SIGMA])
    return Fixes(name, *table[:, :4].T, *sigmas.T, left_out)


def _counts(left_out: Dict[str, int]) -> str:
    return ", ".join(f"{count} {reason}" for reason, count in left_out.items() if count)


def _consistent(stamp: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Which fixes a vehicle can reach from the longest part without a jump."""
    def are_near(i, j):
        return np.linalg.norm(p[i] - p[j], axis=-1) <= LEAST_JUMP + LARGEST_SPEED * np.abs(stamp[i] - stamp[j])

    part = np.cumsum(np.append(0, ~are_near(np.s_[1:], np.s_[:-1])))
    start = int(np.argmax(part == np.argmax(np.bincount(part))))
    is_good = np.zeros(len(p), bool)
    for others in (range(start, len(p)), range(start, -1, -1)):
        last = start
        for i in others:
            if are_near(i, last):
                is_good[i], last = True, i
    return is_good


def clock_checked(track: Path, known: Path, sigma: float, name: str, given: float) -> np.ndarray:
    """The stamps of the known positions by the clock of the track, from the speeds of both. sigma: of a position [m]; given:
    the offset [s] that they contain already. Raises DataError beyond LARGEST_OFFSET."""
    window = float(np.clip(2 * sigma / SPEED_SIGMA, 1.0, 5.0))
    found = _core.clock_offset(*track.speeds(window), *known.speeds(window))
    if found is None:
        if known.stamp[-1] < track.stamp[0] or known.stamp[0] > track.stamp[-1]:
            raise DataError(f"{name}: the stamps, {known.stamp[0]:.1f} to {known.stamp[-1]:.1f} s, do not overlap the images', "
                            f"{track.stamp[0]:.1f} to {track.stamp[-1]:.1f} s, and the motion does not determine the "
                            "offset: give it with --gps-offset")
        print(f"{name}: their clock is not checked, the motion does not determine its offset")
        return known.stamp
    offset, offset_sigma = found
    if abs(offset) < OFFSET_SIGMAS * offset_sigma:
        return known.stamp
    if abs(offset) > LARGEST_OFFSET:
        raise DataError(f"{name}: the speeds show that the stamps are {abs(offset):.2f} s {'early' if offset > 0 else 'late'} by "
                        f"the clock of the images: use --gps-offset {given + offset:.2f}")
    print(f"{name}: the stamps are shifted by {offset:+.2f} s, as the speeds show")
    return known.stamp + offset
