"""`ground_scale_vo run --gps`: the track of a rendered drive, whose positions are known, and its gaps."""

import importlib
import json
import shutil
import types
from xml.etree import ElementTree

import cv2
import gpxpy
import numpy as np
import pytest
import shapely.geometry
from conftest import poses_of, rendered

SEEDS = 3
GAP = (4, 16)  # [s]
PLACE = (49.0, 8.0, 110.0)


@pytest.fixture(scope="module")
def drive(data):
    """20 s and 150 m, with a stop."""
    return rendered(data / "gps_drive", "--frames", 100, "--rate", 5, "--size", "480x148")


@pytest.fixture(scope="module")
def run(gsv, tmp_path_factory):
    """run(folder): the modules, the track of the odometry, its covariances, and the true positions: east, north, up."""
    del gsv
    modules = {name: importlib.import_module(f"ground_scale_vo.{name}") for name in (
        "_core", "calibration", "gps", "gps_track", "odometry")}

    def call(folder):
        core, out = modules["_core"], tmp_path_factory.mktemp("out")
        report = core.run(lambda: modules["odometry"]._open_reader(str(folder), "", 0.0, False, False, "", 0.0, None, None),
                          "drive", 1.65, [], [], 0.0, str(out), False, False, False)
        right, down, forward = poses_of(folder / "poses.txt")[:, :, 3].T
        east_north = (forward - 1j * right) * np.exp(0.7j)
        return types.SimpleNamespace(
            **modules, folder=folder, out=out, track=modules["calibration"].Track(out), covariances=report["covariances"],
            p=np.stack([east_north.real, east_north.imag, -down], -1))
    return call


@pytest.fixture(scope="module")
def ran(run, drive):
    return run(drive)


def fixes_of(ran, seed=0, sigma=0.02, gap=(0, 0), outliers=0.0, canyon=(0, 0), scale=1.0, stated=None):
    """One each second: with white noise, none in the gap, a share of them gross outliers, and those of a canyon 20 m off."""
    random, stamp = np.random.default_rng(seed), np.arange(0.04, ran.track.stamp[-1], 1.0)
    p = scale * np.stack([np.interp(stamp, ran.track.stamp, axis) for axis in ran.p.T], -1)
    p += sigma * random.normal(size=p.shape) * [1, 1, 2]
    p[random.random(len(p)) < outliers] += [25, -15, 0]
    p[(stamp > canyon[0]) & (stamp < canyon[1])] += 20 * np.append(random.permutation([0.6, 0.8]), 0)
    keep = (stamp < gap[0]) | (stamp > gap[1])
    places = ran.gps.LocalFrame(*PLACE).wgs84(p)[keep]
    sigmas = np.full(keep.sum(), stated or sigma)
    return ran.gps.Fixes("fixes", stamp[keep], *places.T, sigmas, 2 * sigmas, {})


def errors_of(ran, fixes, result):
    """Horizontal, of each frame of the result, and the distance travelled there."""
    true = fixes.frame().positions(*ran.gps.LocalFrame(*PLACE).wgs84(ran.p).T)
    true = np.stack([np.interp(result.stamp, ran.track.stamp, axis) for axis in true.T], -1)
    steps = np.linalg.norm(np.diff(true, axis=0, prepend=true[:1]), axis=1)
    return np.linalg.norm((result.p - true)[:, :2], axis=1), steps.cumsum()


@pytest.mark.parametrize("gap", [GAP, (-1, 12)], ids=["gap", "start in a garage"])
def test_gap_between_exact_fixes(ran, gap):
    """Errors of at most 1 % of the distance since the nearer end, but for 0.1 m; inside the corridor, which is no wider than
    it must be."""
    fixes = fixes_of(ran, gap=gap)
    result = ran.gps_track.fit(ran.track, ran.covariances, fixes, 0.0)
    error, distance = errors_of(ran, fixes, result)
    inside = (result.stamp > gap[0]) & (result.stamp < gap[1])
    before = distance - distance[inside][0] if gap[0] > 0 else np.inf
    nearer = np.minimum(before, distance[inside][-1] - distance)[inside]
    assert nearer.max() > 15 and (error[inside] <= 0.1 + 0.01 * nearer).all(), error[inside].max()
    assert (error <= result.radius).mean() >= 0.95
    assert (result.radius[inside] <= 0.6 + 0.04 * nearer).all() and result.is_used.all()


@pytest.mark.parametrize("change", [
    {"gap": GAP}, {"outliers": 0.15}, {"canyon": (6, 12)}, {"canyon": (-1, 4)}, {"canyon": (6, 12), "gap": (12, 16)}], ids=str)
def test_noise_and_outliers(ran, change):
    """Those 20 m off are found, and without them the track is as good as 2 m of noise allow."""
    inside = []
    for seed in range(SEEDS):
        fixes = fixes_of(ran, seed, 2.0, **change)
        result = ran.gps_track.fit(ran.track, ran.covariances, fixes, 0.0)
        error, _ = errors_of(ran, fixes, result)
        true = fixes.frame().positions(*ran.gps.LocalFrame(*PLACE).wgs84(ran.p).T)
        true = np.stack([np.interp(result.fix_stamp, ran.track.stamp, axis) for axis in true.T], -1)
        away = np.linalg.norm((result.fixes - true)[:, :2], axis=1)
        assert not result.is_used[away > 14].any() and result.is_used[away < 5].all() and error.max() < 4, (seed, error.max())
        assert result.radius.max() < 8  # correlated errors of the fixes cannot be seen
        inside.append(error <= result.radius)
    assert np.mean(inside) >= 0.95


def test_lost_map(run, drive, tmp_path):
    """The second map has another unit, and the fixes lead over what lies between."""
    lossy = shutil.copytree(drive, tmp_path / "lossy")
    for file in sorted((lossy / "image_0").iterdir())[30:40]:
        cv2.imwrite(str(file), np.full((148, 480), 99, np.uint8))
    ran = run(lossy)
    assert (ran.track.section < 0).sum() >= 10
    fixes = fixes_of(ran, gap=(12, 16))
    result = ran.gps_track.fit(ran.track, ran.covariances, fixes, 0.0)
    error, _ = errors_of(ran, fixes, result)
    assert result.is_used.mean() > 0.8 and (error <= result.radius).mean() >= 0.95
    assert error[(result.stamp > 12) & (result.stamp < 16)].max() < 0.5 and error.max() < 3


def test_a_map_that_follows_another_is_another_section(ran, tmp_path):
    """Both have a metric pose in each frame, but the step between them is not known."""
    two = shutil.copytree(ran.out, tmp_path / "two")
    header, *rows = [line.split(",") for line in (two / "scale.csv").read_text().split()]
    for row in rows[60:]:
        row[header.index("map_id")] = "1"
    (two / "scale.csv").write_text("\n".join(",".join(row) for row in [header, *rows]))
    section = ran.calibration.Track(two).section
    assert len(set(section[40:60])) == len(set(section[60:80])) == 1 and -1 != section[59] != section[60] != -1


def test_contradicting_scale(ran):
    """True lengths 10 % longer: the camera height was 10 % too small, which is not taken over silently."""
    result = ran.gps_track.fit(ran.track, ran.covariances, fixes_of(ran, sigma=0.5, scale=1.1), 0.0)
    sentence = result.contradiction(1.65)
    assert "% (95 %) too short: the camera height of 1.65 m is probably wrong, 1.8" in sentence
    assert ran.gps_track.fit(ran.track, ran.covariances, fixes_of(ran, sigma=0.5), 0.0).contradiction(1.65) == ""


@pytest.mark.parametrize("change, sentence", [
    ({"gap": (2.5, 99), "sigma": 5.0}, "too close together for the heading"), ({"gap": (0.5, 99)}, "fewer than 2 are between"),
    ({"sigma": 30.0, "stated": 0.02}, "agree with the trajectory")])
def test_fixes_that_do_not_determine_the_track(ran, change, sentence):
    with pytest.raises(ran.gps.DataError, match=sentence):
        ran.gps_track.fit(ran.track, ran.covariances, fixes_of(ran, **change), 0.0)


def test_another_clock(ran):
    fixes = fixes_of(ran)
    with pytest.raises(ran.gps.DataError, match="late by the clock of the images: use --gps-offset -[45]"):
        ran.gps_track.fit(ran.track, ran.covariances, fixes._replace(stamp=fixes.stamp + 5), 0.0)


def write_fixes(file, fixes):
    rows = zip(fixes.stamp, fixes.latitude, fixes.longitude, fixes.altitude, fixes.sigma_h)
    file.write_text("stamp,lat,lon,alt,sigma\n" + "".join(",".join(map(repr, row)) + "\n" for row in rows))
    return file


def test_files(gsv_command, ran, tmp_path):
    """The track in all files is near the true one, and inside the corridor."""
    fixes = fixes_of(ran, sigma=0.5, gap=GAP, canyon=(0.5, 2.5))
    file = write_fixes(tmp_path / "fixes.csv", fixes)
    status, output, _ = gsv_command("run", ran.folder, "--camera-height", 1.65, "--out", tmp_path, "--gps", file)
    assert status == 0 and "6 fixes are used, 2 are outliers; the longest gap is 13.0 s" in output, output
    folder = tmp_path / ran.folder.name
    true = ran.gps.LocalFrame(*PLACE).wgs84(ran.p)
    points = gpxpy.parse((folder / "track.gpx").read_text()).tracks[0].segments[0].points
    assert [point.time.timestamp() for point in points] == pytest.approx(ran.track.stamp)
    shapes = {one["properties"]["name"]: shapely.geometry.shape(one["geometry"]) for one in json.loads(
        (folder / "track.geojson").read_text())["features"]}
    assert all(shape.is_valid for shape in shapes.values())
    assert (len(shapes["fixes"].geoms), len(shapes["outliers"].geoms)) == (6, 2)
    corridor = shapes["95 % corridor"]
    assert np.mean([corridor.contains(shapely.geometry.Point(lon, lat)) for lat, lon, _ in true]) >= 0.95
    kml = ElementTree.parse(folder / "track.kml")
    line = kml.find(".//{*}LineString/{*}coordinates").text.split()
    for track in ([(p.latitude, p.longitude) for p in points], [(lat, lon) for lon, lat, *_ in shapes["track"].coords],
                  [tuple(map(float, place.split(",")[1::-1])) for place in line]):
        metres = (np.array(track) - true[:, :2]) * [111200, 73200]
        assert np.linalg.norm(metres, axis=1).max() < 1.5
    assert kml.find(".//{*}outerBoundaryIs//{*}coordinates") is not None
    assert (folder / "track.png").exists() and "outliers" in (folder / "report.html").read_text()


def test_failures_of_the_command(gsv_command, low, low_bag, shortest, tmp_path):
    """Of a topic, a wrong height; of a missing file, before the drive is run; and no track of an earlier run remains."""
    status, _, errors = gsv_command("run", low_bag, "--image", "/kitti/camera_gray_left/image_rect", "--gps", "/fix",
                                    "--camera-height", 0.8, "--out", tmp_path)
    assert status == 1 and "too long: the camera height of 0.8 m is probably wrong, 0." in errors
    said = json.loads((tmp_path / low_bag.stem / "run.json").read_text())
    assert "too long" in said["failure"] and (tmp_path / low_bag.stem / "track.gpx").exists()
    status, _, errors = gsv_command("run", low, "--gps", "none.gpx", "--camera-height", 0.6, "--out", tmp_path / "none")
    assert status == 1 and "none.gpx: No such file" in errors and not (tmp_path / "none").exists()
    status, _, errors = gsv_command("run", low, "--gps-offset", 1, "--camera-height", 0.6)
    assert status == 2 and "--gps-offset is for --gps" in errors
    stale = tmp_path / shortest.name / "track.kml"
    stale.parent.mkdir()
    stale.touch()
    gsv_command("run", shortest, "--camera-height", 1.65, "--out", tmp_path)
    assert (stale.parent / "poses.txt").exists() and not stale.exists()
