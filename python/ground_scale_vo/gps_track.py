"""`ground_scale_vo run --gps`: the trajectory on the map, with the gaps between the fixes filled."""

import datetime
import json
import math
import pathlib
from typing import Any, Dict, NamedTuple, Optional, Tuple
from xml.etree import ElementTree

import numpy as np

from . import _core, gps
from .calibration import METHOD_SIGMA, Track
from .odometry import DataError
from .pose_graph import LEAST_USED, SLOPE_CORRELATION_S, Odometry, Smoother

RADIUS_95 = 2.4477  # [standard deviations] of a circle that contains 95 % of the horizontal errors
LOOSE_SCALE_SIGMA = 0.3  # of the scale while the fixes alone determine it
SCALE_SIGMAS = 3.0  # by which the scales of fixes and odometry may differ
LARGEST_HEADING_SIGMA = 0.2  # [rad]
ACCELERATION_SIGMA = 2.0  # [m/s^2] while tracking is lost
LARGEST_SIGMA_V = 100.0  # [m] of an altitude that is written


class GpsTrack(NamedTuple):
    """Of each frame between the first and last metric pose, in the frame of the fixes."""

    frame: gps.LocalFrame
    stamp: np.ndarray  # [s]
    p: np.ndarray  # N x 3 [m]
    radius: np.ndarray  # [m] of the circle that contains the horizontal position with 95 %
    sigma_v: np.ndarray  # [m]
    fix_stamp: np.ndarray  # of the fixes between the first and the last stamp
    fixes: np.ndarray  # M x 3 [m]
    is_used: np.ndarray  # M; False: an outlier
    scale: float  # true lengths over those of the odometry, as the fixes alone show
    scale_sigma: float
    odometry_sigma: float  # relative, of the scale of the odometry

    def longest_gap(self) -> Tuple[float, float, float]:
        """Between fixes that are used, or to an end: duration [s], distance [m], largest radius [m]."""
        edges = np.concatenate([self.stamp[:1], self.fix_stamp[self.is_used], self.stamp[-1:]])
        i = int(np.argmax(np.diff(edges)))
        inside = (self.stamp >= edges[i]) & (self.stamp <= edges[i + 1])
        steps = np.linalg.norm(np.diff(self.p[inside], axis=0), axis=1)
        return float(edges[i + 1] - edges[i]), float(steps.sum()), float(self.radius[inside].max(initial=0.0))

    def summary(self) -> str:
        seconds, metres, radius = self.longest_gap()
        return (f"{self.is_used.sum()} fixes are used, {(~self.is_used).sum()} are outliers; the longest gap is {seconds:.1f} s "
                f"and {metres:.0f} m, known to {radius:.1f} m (95 %)")

    def contradiction(self, height: float) -> str:
        """Between the scales of fixes and odometry, a sentence; empty: none. height: of the camera [m]; 0: not given."""
        sigma = math.hypot(self.scale_sigma, self.odometry_sigma)
        if abs(math.log(self.scale)) <= SCALE_SIGMAS * sigma:
            return ""
        cause = (f"the camera height of {height:g} m is probably wrong, {height * self.scale:.2f} m agrees with them"
                 if height else "the speeds are probably wrong")
        error = 100 * (1 / self.scale - 1)
        kind = "long" if error > 0 else "short"
        return f"by the fixes all lengths are {abs(error):.1f} ± {196 * sigma:.1f} % (95 %) too {kind}: {cause}"


def odometry_of(track: Track, covariances: np.ndarray) -> Odometry:
    """covariances: N x 6 x 6 of the poses; NaN without one. Other frames get theirs from their neighbours, those before the
    first one from the start, since which its covariance is that of the motion."""
    metric = np.flatnonzero(np.isfinite(covariances[:, 0, 0]))
    start = min(metric[0], max(np.argmax(np.any(track.p != track.p[0], axis=1)) - 1, 0))
    frames = slice(start, metric[-1] + 1)
    p, own = track.p[metric], covariances[metric]
    own[:, :3, :3] -= track.height_sigma[metric, None, None]**2 * p[:, :, None] * p[:, None]
    lost_s = np.where(np.diff(metric) > 1, np.diff(track.stamp[metric]), 0)
    own[1:, range(3), range(3)] += (ACCELERATION_SIGMA**2 * lost_s**4 / 16).cumsum()[:, None]
    is_lost = track.section[frames] < 0
    if start < metric[0]:
        is_lost[:metric[0] - start] = False
        p, own, metric = (np.append(first, rest, 0) for first, rest in
                          ((track.p[[start]], p), (np.zeros((1, 6, 6)), own), ([start], metric)))
    known = Odometry(track.stamp[metric], p, own, np.empty(0), float(track.height_sigma[metric[-1]]))
    stamp = track.stamp[frames]
    p = np.where(is_lost[:, None], known.at(stamp, p), track.p[frames])
    return known._replace(stamp=stamp, p=p, covariance=known.at(stamp, own), up=up_of(track)[frames])


def up_of(track: Track) -> np.ndarray:
    """N x 3: the mean normal of the road around each frame; of an image that is not tilted, where no road is measured."""
    normals = np.where(track.section[:, None] >= 0, np.einsum("nij,nj->ni", track.R, track.normal), 0)
    if not normals.any():
        normals = -track.R[:, :, 1]
    sums = np.append(np.zeros((1, 3)), normals.cumsum(0), 0)
    first, last = (np.searchsorted(track.stamp, track.stamp + side * SLOPE_CORRELATION_S / 2) for side in (-1, 1))
    means = sums[last] - sums[first]
    means = np.where(means.any(1, keepdims=True), means, sums[-1])
    return means / np.linalg.norm(means, axis=1, keepdims=True)


def fit(track: Track, covariances: np.ndarray, fixes: gps.Fixes, offset: float) -> GpsTrack:
    """covariances: as of odometry_of(). offset: to add to the stamps of the fixes [s], of which the speeds may show a rest.
    Raises DataError."""
    odometry, stamp, z = odometry_of(track, covariances), fixes.stamp + offset, fixes.positions()
    sigma = np.stack([fixes.sigma_h, fixes.sigma_h, fixes.sigma_v], -1)

    def started(stamp: np.ndarray) -> Optional[Smoother]:
        inside = np.flatnonzero((stamp >= odometry.stamp[0]) & (stamp <= odometry.stamp[-1]))
        return Smoother(odometry, inside, stamp[inside], z[inside], sigma[inside]) if len(inside) > 1 else None

    smoother = started(stamp)
    # Outliers would show another offset of the clock; by another clock most fixes are outliers.
    is_aligned = smoother and smoother.is_used.mean() >= LEAST_USED
    trusted = smoother.fixes[smoother.is_used] if is_aligned else np.arange(len(z))
    known = gps.Path(stamp[trusted], z[trusted])
    shift = gps.clock_checked(track, known, float(np.median(fixes.sigma_h)), fixes.name, offset)[0] - known.stamp[0]
    smoother = started(stamp + shift) if shift else smoother
    if not smoother:
        raise DataError(f"{fixes.name}: fewer than 2 are between the first and the last image with a metric pose")
    if smoother.is_used.mean() < LEAST_USED:
        raise DataError(f"{fixes.name}: only {smoother.is_used.sum()} of {len(smoother.z)} agree with the trajectory, as by another "
                        "clock: see --gps-offset")
    covariance = smoother.refine(LOOSE_SCALE_SIGMA)
    heading_sigma = math.sqrt(covariance[:, 5, 5].min())
    if heading_sigma > LARGEST_HEADING_SIGMA:
        raise DataError(f"{fixes.name}: they are too few or too close together for the heading, whose standard deviation is "
                        f"{math.degrees(heading_sigma):.0f} degrees")
    middle = len(smoother.stamp) // 2
    scale, scale_sigma = math.exp(smoother.scale[middle]), math.sqrt(covariance[middle, 6, 6])
    odometry_sigma = math.hypot(odometry.height_sigma, METHOD_SIGMA)
    if abs(math.log(scale)) <= SCALE_SIGMAS * math.hypot(scale_sigma, odometry_sigma):
        covariance = smoother.refine(odometry_sigma)
    p, marginal = smoother.frames(covariance)
    radius = RADIUS_95 * np.sqrt(np.linalg.eigvalsh(marginal[:, :2, :2])[:, -1])
    return GpsTrack(fixes.frame(), odometry.stamp, p, radius, np.sqrt(marginal[:, 2, 2]), smoother.fix_stamp, smoother.z,
                    smoother.is_used, scale, scale_sigma, odometry_sigma)


def corridor(track: GpsTrack) -> Any:
    """The shape of the places within the radius of the track, longitude and latitude [degrees]."""
    geometry, ops = gps.library("shapely.geometry", "python3-shapely"), gps.library("shapely.ops", "python3-shapely")
    steps = np.linalg.norm(np.diff(track.p[:, :2], axis=0, prepend=track.p[:1, :2]), axis=1)
    corners = np.unique(np.floor((2 * steps / np.maximum(track.radius, 4.0)).cumsum()), return_index=True)[1]
    corners = np.unique(np.append(corners, len(steps) - 1))
    angles = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    around = np.stack([np.cos(angles), np.sin(angles), 0 * angles], -1) / np.cos(np.pi / 16)
    circles = track.p[corners, None] + track.radius[corners, None, None] * around
    places = track.frame.wgs84(circles.reshape(-1, 3))[:, 1::-1].reshape(len(corners), -1, 2)
    pairs = zip(places, places[1:]) if len(places) > 1 else [(places[0], places[0])]
    return ops.unary_union([geometry.MultiPoint(np.concatenate(pair)).convex_hull for pair in pairs])


def write(folder: pathlib.Path, track: GpsTrack) -> None:
    """Writes track.gpx, track.kml and track.geojson."""
    gpx, shape = gps.library("gpxpy").gpx, corridor(track)
    has_altitude = track.sigma_v.min() < LARGEST_SIGMA_V
    places, fixes = track.frame.wgs84(track.p), track.frame.wgs84(track.fixes)

    def coordinates(rows):
        return [[round(lon, 8), round(lat, 8), *([round(alt, 2)] if has_altitude else [])] for lat, lon, alt in rows.tolist()]

    document, segment = gpx.GPX(), gpx.GPXTrackSegment()
    document.tracks.append(gpx.GPXTrack(name=folder.resolve().name))
    document.tracks[0].segments.append(segment)
    for stamp, (lon, lat, *altitude) in zip(track.stamp, coordinates(places)):
        time = datetime.datetime.fromtimestamp(stamp, datetime.timezone.utc)
        segment.points.append(gpx.GPXTrackPoint(lat, lon, *altitude or [None], time=time))
    _core.write_file(str(folder / "track.gpx"), document.to_xml("1.1"))
    oriented = (gps.library("shapely.geometry").polygon.orient(one) for one in getattr(shape, "geoms", [shape]))
    polygons = [[np.round(ring.coords, 8).tolist() for ring in (one.exterior, *one.interiors)] for one in oriented]
    features = [{"type": "Feature", "properties": {"name": name, **more}, "geometry": {"type": kind, "coordinates": values}}
                for name, kind, values, more in (
                    ("track", "LineString", coordinates(places), {"stamps": track.stamp.tolist()}),
                    ("95 % corridor", "MultiPolygon", polygons, {}),
                    ("fixes", "MultiPoint", coordinates(fixes[track.is_used]), {}),
                    ("outliers", "MultiPoint", coordinates(fixes[~track.is_used]), {}))]
    _core.write_file(str(folder / "track.geojson"), json.dumps({"type": "FeatureCollection", "features": features}))
    _core.write_file(str(folder / "track.kml"), kml_text(folder.resolve().name, coordinates(places), polygons))


def kml_text(name: str, line: Any, polygons: Any) -> str:
    def add(parent, *tags, text=None):
        for tag in tags:
            parent = ElementTree.SubElement(parent, tag)
        parent.text = text
        return parent

    def text(places):
        return " ".join(",".join(map(str, place)) for place in places)

    root = ElementTree.Element("kml", xmlns="http://www.opengis.net/kml/2.2")
    document = add(root, "Document")
    add(document, "name", text=name)
    corridor_mark, line_mark = add(document, "Placemark"), add(document, "Placemark")
    add(corridor_mark, "name", text="95 % corridor")
    add(corridor_mark, "Style", "PolyStyle", "color", text="60ff8000")
    shapes = add(corridor_mark, "MultiGeometry")
    for rings in polygons:
        polygon = add(shapes, "Polygon")
        for i, ring in enumerate(rings):
            add(polygon, "innerBoundaryIs" if i else "outerBoundaryIs", "LinearRing", "coordinates", text=text(ring))
    add(line_mark, "name", text="track")
    add(line_mark, "LineString", "coordinates", text=text(line))
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def read(source: str, drive: str) -> gps.Fixes:
    """gps.read(), after a check that the track can be written."""
    for module, package in (("gpxpy", "python3-gpxpy"), ("shapely.geometry", "python3-shapely")):
        gps.library(module, package)
    return gps.read(source, drive)


def add_to(folder: pathlib.Path, report: Dict[str, Any], fixes: gps.Fixes, offset: float, height: Optional[float]) -> None:
    """Adds the track to the results of a run with a metric pose, and what it shows to the report of _core.run()."""
    said = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    try:
        track = fit(Track(folder), report["covariances"], fixes, offset)
        write(folder, track)
        report["summary"] += f"; {track.summary()}"
        failure = track.contradiction(height or 0.0)
    except DataError as error:
        failure = str(error)
    if failure and not report["failure"]:
        report["failure"] = said["failure"] = failure
        report["status"] = 1
        _core.write_file(str(folder / "run.json"), json.dumps(said, indent=2, ensure_ascii=False) + "\n")
