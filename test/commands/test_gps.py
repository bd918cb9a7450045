"""GPS fixes: what is read from a file or a bag, what is no fix, and whose clock they have."""

import datetime
import functools
import importlib
import operator

import numpy as np
import pytest

START = 1700000000  # [s], 22:13:20
FIXES = [(START + i, 49 + 1e-4 * i, 8 - 2e-4 * i, 110 + 0.5 * i) for i in range(30)]


@pytest.fixture
def gps(gsv):
    del gsv
    return importlib.import_module("ground_scale_vo.gps")


def utc(stamp, pattern):
    return datetime.datetime.fromtimestamp(stamp, datetime.timezone.utc).strftime(pattern)


def gpx(fixes):
    points = "".join(f'<trkpt lat="{lat}" lon="{lon}"><ele>{alt}</ele><time>{utc(t, "%Y-%m-%dT%H:%M:%SZ")}</time></trkpt>'
                     for t, lat, lon, alt in fixes)
    return ('<?xml version="1.0" encoding="UTF-8"?><gpx version="1.1" creator="test" '
            f'xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>{points}</trkseg></trk></gpx>')


def nmea(fixes, is_gga=True):
    """GGA has no date, RMC is sent after it and only every fifth time; a day ends after some."""
    def sentence(text):
        return f"${text}*{functools.reduce(operator.xor, text.encode()):02X}\r\n"

    text = ""
    for i, (t, lat, lon, alt) in enumerate(fixes):
        places = [f"{int(abs(v)):0{n}}{abs(v) % 1 * 60:010.7f},{letters[v < 0]}" for v, n, letters in
                  ((lat, 2, "NS"), (lon, 3, "EW"))]
        time, place = utc(t, "%H%M%S.00"), ",".join(places)
        if is_gga:
            text += sentence(f"GNGGA,{time},{place},1,09,2.0,{alt},M,0.0,M,,")
        if not is_gga or i % 5 == 2:
            text += "1700 " + sentence(f"GPRMC,{time},A,{place},10.0,45.0,{utc(t, '%d%m%y')},,,A")
    return text


def table(heading, line):
    return lambda fixes: heading + "\n" + "".join(line(*fix) + "\n" for fix in fixes)


LATE = [(START + 6390 + i, *fix[1:]) for i, fix in enumerate(FIXES)]  # from 23:59:50 on
FORMATS = {
    "gpx": (gpx, FIXES), "nmea": (nmea, FIXES), "nmea over midnight": (nmea, LATE),
    "nmea, RMC alone": (functools.partial(nmea, is_gga=False), FIXES),
    "csv": (table("stamp, latitude, longitude, altitude", lambda *fix: ", ".join(map(repr, fix))), FIXES),
    "csv, ISO 8601": (table("Time;Lat [deg];Lon [deg];Ele (m)", lambda t, *place: ";".join(
        [utc(t, "%Y-%m-%d %H:%M:%S"), *map(repr, place)])), FIXES),
    "csv, milliseconds": (table("timestamp\tlng\tlat\talt", lambda t, lat, lon, alt: f"{t}000\t{lon}\t{lat}\t{alt}"), FIXES),
    "rostopic echo -p": (table("%time,field.header.stamp,field.status.status,field.latitude,field.longitude,field.altitude",
                               lambda t, *place: f"1,{t}000000000,0," + ",".join(map(repr, place))), FIXES),
}


@pytest.mark.parametrize("name", FORMATS)
def test_formats(gps, tmp_path, name):
    write, fixes = FORMATS[name]
    file = tmp_path / "track.txt"
    file.write_text(write(fixes))
    read = gps.read(str(file), "drive")
    place = np.stack([read.stamp, read.latitude, read.longitude], -1)
    np.testing.assert_allclose(place, [fix[:3] for fix in fixes], rtol=0, atol=1e-8)
    if "RMC" not in name:
        np.testing.assert_allclose(read.altitude, [fix[3] for fix in fixes])
    assert sum(read.left_out.values()) == 0


def test_positions_are_metres(gps, tmp_path):
    """Against the lengths of a second of arc at 49 degrees, on the ellipsoid: 30.892 m and 20.326 m."""
    file = tmp_path / "track.csv"
    file.write_text("stamp,lat,lon,alt\n" + "".join(f"{i},{49 + i / 3600},{8 + i / 3600},{i}\n" for i in range(3)))
    steps = np.diff(gps.read(str(file), "drive").positions(), axis=0)
    np.testing.assert_allclose(steps, [[20.326, 30.892, 1.0]] * 2, atol=0.002)


def test_what_is_no_fix(gps, tmp_path):
    rows = [f"{t},{lat},{lon},{alt},0.5,0" for t, lat, lon, alt in FIXES]
    rows[0] = f"{START},0,0,0,0.5,0"
    rows[1] = f"{START + 1},49.01,8,0,0.5,0"  # 1 km off
    rows[2] = f"{START + 2},,,,0.5,-1"
    rows[3] = f"{START + 3},,,,0.5,0"
    rows[4] = f"{START + 4},49,8,110,99999,0"
    rows[9] = f"{START + 7},49,8,110,0.5,0"
    rows[6] = ",49,8,110,0.5,0"
    rows[7] = f"{START + 7},{FIXES[7][1]},{FIXES[7][2]},110,0,0"  # its standard deviation is not known
    file = tmp_path / "track.csv"
    file.write_text("\n".join(["stamp,latitude,longitude,altitude,sigma,status", *rows]))
    read = gps.read(str(file), "drive")
    assert list(read.stamp) == [START + i for i in range(5, 30) if i not in (6, 9)]
    assert list(read.sigma_h[:3]) == [0.5, 2.5, 0.5]
    assert str(read) == (f"fixes of {file}: 23 are used, left out are 1 without a valid time, 2 without a fix, "
                         "1 without a position, 1 at 0, 0, 1 not later than the one before, 1 far from the others")


@pytest.mark.parametrize("text, sentence", [
    (None, "No such file or directory; fixes come from"), ("<gpx><trk>", "is no GPX file that can be read"),
    ("<kml></kml>", "fixes of .*: there are none"),
    ("a,b\n1,2\n", "with a heading of the columns stamp, latitude and longitude"),
    ("stamp,lat,lon\n1,49,east\n", "track:2: could not convert string to float: 'east'"),
    ("stamp,lat,lon\n1,0,0\n", "fixes of .*: none can be used, of 1 are 1 at 0, 0"),
])
def test_refused_files(gps, tmp_path, text, sentence):
    file = tmp_path / "track"
    if text:
        file.write_text(text)
    with pytest.raises(gps.DataError, match=sentence):
        gps.read(str(file), "drive")


@pytest.mark.parametrize("late, given, outcome", [
    (18, 0, r"18\.00 s late by the clock of the images: use --gps-offset -18\.00"),
    (-1.7e9, 0, r"early by the clock of the images: use --gps-offset 1700000000\.00"), (1, -2, "use --gps-offset -1\\.00"),
    (0.2, 0, -0.2), (0.2, -0.2, 0)])
def test_clock(gps, late, given, outcome):
    """A drive of varying speed, in units of 1.5 m, and fixes of it once a second."""
    def positions(t):
        return np.stack([8 * t - 20 * np.cos(0.21 * t), 5 * np.sin(0.53 * t), 0 * t], -1)

    images, times = np.arange(0, 40, 0.1), np.arange(0, 40, 1.0)
    track = gps.Path(images, positions(images) / 1.5, np.zeros(len(images)))
    known = gps.Path(times + late + given, positions(times), np.zeros(len(times)))
    if isinstance(outcome, str):
        with pytest.raises(gps.DataError, match=outcome):
            gps.clock_checked(track, known, 0.0, "fixes", given)
    else:
        np.testing.assert_allclose(gps.clock_checked(track, known, 0.0, "fixes", given), known.stamp + outcome, atol=0.02)
