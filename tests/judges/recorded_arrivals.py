"""Makes recordings of computed arrivals with known faults, and compares the imported corpus with what was put in.

usage: recorded_arrivals.py make FOLDER adsb|rtk SEED ARRIVALS CAMERAS BOXES_PER_S [--calibrated]
       recorded_arrivals.py judge FOLDER CORPUS      prints JSON
       recorded_arrivals.py residuals TABLES.csv..   prints recorded_arrivals.json, made of 14 arrivals at Paris on 2021-10-07: OpenSky Network
                                                     (https://opensky-network.org), from `traffic` 2.13 (MIT), samples/collections/quickstart

Faults: clocks off by up to 30 s with a drift up to 50 ppm, unsynchronised; boxes with white and lasting errors, missing and false ones;
guessed cameras off by a degree, 1 % of the focal length and 3 m (root mean squares, as stated); surveillance with a constant delay per
aircraft of -0.2 to 0.4 s, repeated positions and scatter of real arrivals (13 to 25 m along the path by ages, 2 m across), gaps up to 13 s,
steps of 25 ft above 1013 hPa in air that is not standard.
Nothing here was taken from the importer: geometry is GeographicLib's and a pinhole of its own.
"""

import csv
import json
import math
import pathlib
import sys

import numpy as np
import pyarrow.parquet as pq
from geographiclib.geodesic import Geodesic

EARTH = Geodesic.WGS84
THRESHOLD, ELEVATION_M, COURSE_DEG, PAST_M = (1.34897196, 103.97750124), 6.71, 23.02, 340.1
START_UTC_S = 1_772_352_000.0  # 2026-03-01T08:00:00Z
WIDTH, HEIGHT, HFOV_DEG = 1920, 1280, 20.0
FOCAL_PX = WIDTH / 2 / math.tan(math.radians(HFOV_DEG / 2))
NM = 1852.0
STEP_S = 0.5
RESIDUALS = pathlib.Path(__file__).with_suffix(".json")
MAX_REPEATED = 13
AVERAGED = 15  # rows on both sides, for the path from which residuals are taken


def destination(place, azimuth_deg, distance_m):
    to = EARTH.Direct(place[0], place[1], azimuth_deg, distance_m)
    return to["lat2"], to["lon2"]


TARGET = destination(THRESHOLD, COURSE_DEG, PAST_M)


def ecef(latitude_deg, longitude_deg, height_m):
    a, e2 = EARTH.a, EARTH.f * (2 - EARTH.f)
    lat, lon = np.radians(latitude_deg), np.radians(longitude_deg)
    n = a / np.sqrt(1 - e2 * np.sin(lat) ** 2)
    h = np.asarray(height_m)
    return np.stack([(n + h) * np.cos(lat) * np.cos(lon), (n + h) * np.cos(lat) * np.sin(lon), (n * (1 - e2) + h) * np.sin(lat)], axis=-1)


def ned_axes(latitude_deg, longitude_deg):
    lat, lon = math.radians(latitude_deg), math.radians(longitude_deg)
    north = [-math.sin(lat) * math.cos(lon), -math.sin(lat) * math.sin(lon), math.cos(lat)]
    east = [-math.sin(lon), math.cos(lon), 0.0]
    down = [-math.cos(lat) * math.cos(lon), -math.cos(lat) * math.sin(lon), -math.sin(lat)]
    return np.array([north, east, down])


def axes_of(camera):
    """Right, down and forward of a camera, in ECEF."""
    heading, pitch, roll = (math.radians(camera[name]) for name in ("heading_deg", "pitch_deg", "roll_deg"))
    forward = np.array([math.cos(pitch) * math.cos(heading), math.cos(pitch) * math.sin(heading), -math.sin(pitch)])
    level = np.array([-math.sin(heading), math.cos(heading), 0.0])
    below = np.cross(forward, level)
    right = math.cos(roll) * level + math.sin(roll) * below
    ned = ned_axes(camera["latitude_deg"], camera["longitude_deg"])
    return np.array([right, np.cross(forward, right), forward]) @ ned


def project(camera, points_m):
    centre = ecef(camera["latitude_deg"], camera["longitude_deg"], camera["altitude_m"])
    seen = (points_m - centre) @ axes_of(camera).T
    z = np.maximum(seen[:, 2], 1e-9)
    px = camera["focal_px"] * seen[:, :2] / z[:, None] + np.array([(WIDTH - 1) / 2, (HEIGHT - 1) / 2])
    return px, seen[:, 2]


class Flight:
    """A true arrival, twice a second, past the target."""

    def __init__(self, random, start_s):
        along, speed, time = random.uniform(10.5, 11.5) * NM, random.uniform(82, 90), start_s
        final, offset, wander, phase = random.uniform(66, 74), random.uniform(-120, 120), random.uniform(2, 8), random.uniform(0, 6.3)
        steep, level = math.tan(math.radians(3.0 + random.uniform(-0.05, 0.05))), random.uniform(700, 900)
        rows = []
        gust = 0.0
        while along > -1_800 and speed > 25:
            part = min(max(along / (11 * NM), 0.0), 1.0)
            cross = offset * part**3 + wander * part * math.sin(phase + 15 * part)
            height = max(min(along * steep, level) + 1.5 * math.sin(time / 19 + phase) * min(part * 4, 1), 3.5)
            at = destination(TARGET, COURSE_DEG + 180, along) if along >= 0 else destination(TARGET, COURSE_DEG, -along)
            at = destination(at, COURSE_DEG + 90, cross)
            rows.append((time, at[0], at[1], ELEVATION_M + height, speed + gust, along < 0))
            gust += STEP_S * (-gust / 20 + random.normal(0, 0.15))
            want = final if along < 6 * NM else 85.0
            want = want if along > -50 else 20.0
            speed += STEP_S * np.clip(want - speed, -2.0 if along < 0 else -0.7, 0.7)
            along -= STEP_S * (speed + gust)
            time += STEP_S
        self.rows = np.array(rows)
        self.times, self.ground = self.rows[:, 0], self.rows[:, 5] > 0
        self.dtd = np.array([EARTH.Inverse(r[1], r[2], *TARGET)["s12"] for r in rows])
        passing = int(np.argmax(self.ground))
        self.passing_s = self.times[passing]

    def at(self, times):
        return [np.interp(times, self.times, self.rows[:, column]) for column in (1, 2, 3)]


def coloured(random, count, period_s, sd, lasts_s):
    keep = math.exp(-period_s / lasts_s)
    out = np.zeros((count, 2))
    for i in range(1, count):
        out[i] = keep * out[i - 1] + math.sqrt(1 - keep * keep) * random.normal(0, sd, 2)
    return out


def residuals(files):
    """Per second of an arrival: whether its position is new, and its metres ahead of the path and to the right of it."""
    arrivals = {}
    for file in sorted(files):
        rows = [row for row in csv.DictReader(open(file)) if row["latitude"] and row["groundspeed"] and row["track"]]
        flying = [row for row in rows if row["onground"] == "False" and float(row["groundspeed"]) > 90]
        end = [float(flying[-1][name]) for name in ("latitude", "longitude")]
        near = [row for row in flying if EARTH.Inverse(float(row["latitude"]), float(row["longitude"]), *end)["s12"] < 20_000]
        course = np.median([float(row["track"]) for row in near[-60:]])
        near = [row for row in near if abs(float(row["track"]) - course) < 5]
        # Rows that repeat a position for longer than gaps last are of an aircraft out of reach.
        places = [(row["latitude"], row["longitude"]) for row in near]
        changes = [0, *(i for i in range(1, len(near)) if places[i] != places[i - 1]), len(near)]
        lost = [(i, j) for i, j in zip(changes, changes[1:]) if j - i > MAX_REPEATED]
        parts = zip([0, *(j for _, j in lost)], [*(i for i, _ in lost), len(near)])
        near = max((near[i:j] for i, j in parts), key=len)
        if len(near) < 120 or max(np.diff([float(row["timestamp"]) for row in near])) > 1_500:
            continue
        table = np.array([[float(row[name]) for name in ("timestamp", "latitude", "longitude", "groundspeed", "track")] for row in near])
        way = [EARTH.Inverse(*table[0, 1:3], *row[1:3]) for row in table]
        place = np.array([[w["s12"] * math.cos(math.radians(w["azi1"] - course)), w["s12"] * math.sin(math.radians(w["azi1"] - course))] for w in way])
        off = np.radians(table[:, 4] - course)
        flown = np.cumsum(np.stack([np.cos(off), np.sin(off)], axis=1) * 0.514444 * table[:, 3:4], axis=0)
        new = np.r_[True, np.abs(np.diff(table[:, 1:3], axis=0)).sum(axis=1) > 0]
        error = (place - flown)[new]
        error -= [error[max(i - AVERAGED, 0):i + AVERAGED + 1].mean(axis=0) for i in range(len(error))]
        every = np.round(error[np.cumsum(new) - 1], 1)
        name = pathlib.Path(file).stem
        arrivals[name] = [[int(is_new), *values] for is_new, values in zip(new, every.tolist())]
    print(json.dumps(arrivals))


def adsb_rows(random, flight, icao, delay_s):
    """What receivers write of a flight, once a second."""
    rows, last, gap_until = [], None, 0.0
    hectopascal_m, stretch = random.uniform(-30, 30) * 8.3, random.uniform(0.94, 1.07)
    real = list(json.loads(RESIDUALS.read_text()).values())
    real = real[random.integers(len(real))]
    first = random.integers(len(real))
    for second, stamp in enumerate(np.arange(math.ceil(flight.times[0] + 1), flight.times[-1] - 1)):
        true_s = stamp - delay_s
        if not flight.times[0] <= true_s <= flight.times[-1]:
            continue
        if stamp < gap_until:
            continue
        if random.random() < 0.01:
            gap_until = stamp + random.uniform(2, 13)
        lat, lon, height = (float(v[0]) for v in flight.at(np.array([true_s])))
        speed = float(np.interp(true_s, flight.times, flight.rows[:, 4]))
        is_new, ahead_m, right_m = real[(first + second) % len(real)]
        if last is None or is_new:
            last = destination(destination((lat, lon), COURSE_DEG, ahead_m), COURSE_DEG + 90, right_m)
        feet = (ELEVATION_M + (height - ELEVATION_M) / stretch + hectopascal_m) / 0.3048
        ground = bool(np.interp(true_s, flight.times, flight.rows[:, 5]) > 0.5)
        rows.append([f"{stamp:.1f}", icao, f"{last[0]:.6f}", f"{last[1]:.6f}", round(25 * round(feet / 25)), round(speed / 0.514444), f"{COURSE_DEG:.1f}", ground])
    return rows


def make(folder, kind, seed, arrivals, cameras, rate, calibrated):
    random = np.random.default_rng(seed)
    folder.mkdir(parents=True)
    start, flights = START_UTC_S, []
    for _ in range(arrivals):
        start += random.uniform(140, 240)
        flights.append(Flight(random, start))
    truth = {"kind": kind, "cameras": {}, "flights": {}}
    toml = ['name = "tower"', 'runway = "WSSS/02L"', 'geoid = "EGM2008"', ""]
    points = {}
    last_s = flights[-1].times[-1]
    for number in range(cameras):
        side = -1 if number % 2 == 0 else 1
        at = destination(destination(TARGET, COURSE_DEG, random.uniform(-100, 500)), COURSE_DEG + 90, side * random.uniform(200, 400))
        true = {
            "latitude_deg": at[0], "longitude_deg": at[1], "altitude_m": ELEVATION_M + random.uniform(8, 25),
            "heading_deg": (COURSE_DEG + 180 - side * random.uniform(0, 3)) % 360, "pitch_deg": random.uniform(2, 3),
            "roll_deg": random.uniform(-1, 1), "focal_px": FOCAL_PX * random.uniform(0.97, 1.03),
        }
        offset_s, drift_ppm = random.uniform(-30, 30), random.uniform(-50, 50)
        name = f"camera{number}"
        images = np.arange(START_UTC_S + random.uniform(0, 1 / rate), last_s, 1 / rate)
        by_camera = images - offset_s - 1e-6 * drift_ppm * (images - START_UTC_S)
        white, lasting = random.normal(0, 0.4, (len(images), 2)), coloured(random, len(images), 1 / rate, 0.3, 4.0)
        rows = []
        for flight in flights:
            near = (images >= flight.times[0]) & (images <= flight.times[-1])
            lat, lon, height = flight.at(images[near])
            px, depth = project(true, ecef(lat, lon, height + 1.0))
            size = np.stack([34 / depth, 12 / depth], axis=-1) * true["focal_px"]
            centre = px + white[near] + lasting[near]
            whole = (depth > 300) & (np.abs(centre - [WIDTH / 2, HEIGHT / 2]) + size / 2 < [WIDTH / 2, HEIGHT / 2]).all(axis=1)
            found = whole & (random.random(len(whole)) > 0.1) & (depth < 10.5 * NM)
            for time, c, s in zip(by_camera[near][found], centre[found], size[found]):
                rows.append((time, *c, *s, 0.9))
        for _ in range(len(rows) // 50):
            rows.append((random.choice(by_camera), random.uniform(100, 1800), random.uniform(100, 1100), 40.0, 20.0, 0.5))
        with open(folder / f"{name}.csv", "w", newline="") as file:
            out = csv.writer(file)
            out.writerow(["time", "cx", "cy", "width", "height", "score"])
            out.writerows([f"{r[0]:.4f}", *(f"{v:.2f}" for v in r[1:5]), r[5]] for r in sorted(rows))
        points[name] = len(rows)
        truth["cameras"][name] = {**true, "offset_s": offset_s, "drift_ppm": drift_ppm}
        given = dict(true)
        if not calibrated:
            for key in ("heading_deg", "pitch_deg", "roll_deg"):
                given[key] += random.normal(0, 0.6)
            given["focal_px"] *= 1 + random.normal(0, 0.01)
            north, east, up = random.normal(0, 1.75, 3).tolist()
            moved = destination(destination(at, 0, north), 90, east)
            given.update(latitude_deg=moved[0], longitude_deg=moved[1], altitude_m=true["altitude_m"] + up)
        toml += ["[[camera]]", f'name = "{name}"', f"width_px = {WIDTH}", f"height_px = {HEIGHT}", f'boxes = "{name}.csv"', "clock_sd_s = 15.0", "drift_sd_ppm = 30.0"]
        if calibrated:
            toml += ['calibration = "calibration.json"', ""]
        else:
            toml += ["position_sd_m = 1.75", "direction_sd_deg = 0.6", "focal_sd_pct = 1.0", "[camera.guess]"]
            toml += [f"{key} = {value!r}" for key, value in given.items()] + [""]
    if calibrated:
        write_calibration(folder / "calibration.json", truth["cameras"])
    tracks = []
    for number, flight in enumerate(flights):
        icao, delay_s = f"{0x76CC00 + number:06x}", 0.0
        if kind == "adsb":
            delay_s = random.uniform(-0.2, 0.4)
            tracks += adsb_rows(random, flight, icao, delay_s)
        else:
            times = np.arange(flight.times[0], flight.times[-1], 0.1)
            lat, lon, height = flight.at(times)
            tracks += [[f"{t:.3f}", icao, f"{a:.9f}", f"{o:.9f}", f"{h + random.normal(0, 0.02):.3f}"] for t, a, o, h in zip(times, lat, lon, height)]
        truth["flights"][icao] = {"delay_s": delay_s, "times": flight.times.tolist(), "dtd": np.where(flight.ground, -flight.dtd, flight.dtd).tolist()}
    header = ["timestamp", "icao24", "latitude", "longitude", "altitude", "groundspeed", "track", "onground"]
    if kind == "rtk":
        header = ["t", "icao24", "lat", "lon", "height"]
    with open(folder / "tracks.csv", "w", newline="") as file:
        out = csv.writer(file)
        out.writerow(header)
        out.writerows(tracks)
    toml += ["[[track]]", 'file = "tracks.csv"']
    if kind == "rtk":
        toml += ["position_sd_m = 0.05", 'columns = { time = "t", aircraft = "icao24", latitude = "lat", longitude = "lon", altitude_m = "height" }']
    (folder / "recording.toml").write_text("\n".join(toml) + "\n")
    (folder / "truth.json").write_text(json.dumps(truth))
    print(json.dumps({"boxes": points, "track_rows": len(tracks)}))


def write_calibration(path, cameras):
    entries = {}
    for name, camera in cameras.items():
        centre = ecef(camera["latitude_deg"], camera["longitude_deg"], camera["altitude_m"])
        f = camera["focal_px"]
        entries[name] = {
            "width_px": WIDTH, "height_px": HEIGHT, "k": [[f, 0, (WIDTH - 1) / 2], [0, f, (HEIGHT - 1) / 2], [0, 0, 1]], "distortion": [],
            "ecef_from_camera": {"rotation": axes_of(camera).T.tolist(), "translation_m": centre.tolist()},
            "placed": {
                "latitude_deg": camera["latitude_deg"], "longitude_deg": camera["longitude_deg"], "altitude_msl_m": camera["altitude_m"],
                "heading_true_deg": camera["heading_deg"], "pitch_deg": camera["pitch_deg"], "roll_deg": camera["roll_deg"],
                "hfov_deg": 2 * math.degrees(math.atan(WIDTH / 2 / f)),
            },
        }
    words = {"camera_axes": "OpenCV: x right, y down, z forward", "pixel_origin": "(0, 0) is the centre of the top-left pixel", "world": "ECEF metres on WGS-84"}
    path.write_text(json.dumps({"conventions": words, "cameras": entries}))


def judge(folder, corpus):
    truth = json.loads((folder / "truth.json").read_text())
    to_track, between, deviations, errors, sds, per_flight = [], [], [], [], [], []
    cameras = {}
    for path in sorted(corpus.glob("scenarios/*/scenario.json")):
        record = json.loads(path.read_text())
        recorded = record["recorded"]
        icao = next(icao for icao in truth["flights"] if icao in record["id"])
        flight = truth["flights"][icao]
        table = pq.read_table(path.parent / "frames.parquet").to_pydict()
        cameras = json.loads((path.parent / "calibration.json").read_text())["cameras"]
        off = {}
        own_errors = []
        for view, clock in recorded["clocks"].items():
            true = truth["cameras"][view]
            start_by_camera = recorded["start_utc_s"] - clock["offset_s"]
            true_offset = true["offset_s"] + 1e-6 * true["drift_ppm"] * (start_by_camera + true["offset_s"] - START_UTC_S)
            off[view] = clock["offset_s"] - true_offset - flight["delay_s"]
            to_track.append(off[view])
            deviations.append(clock["offset_sd_s"])
            for tick, image, dtd, sd in zip(table["time_ns"], table[f"image_time_ns_{view}"], table["dtd_m"], table["dtd_sd_m"]):
                if image is None or not NM < dtd < 10 * NM:
                    continue
                # The true time of the image by the camera's clock, moved to the tick.
                by_camera = recorded["start_utc_s"] + image / 1e9 - clock["offset_s"]
                true_s = by_camera + true_offset + (tick - image) / 1e9
                own_errors.append(dtd - np.interp(true_s, flight["times"], flight["dtd"]))
                errors.append(own_errors[-1])
                sds.append(sd)
        views = list(off)
        between += [off[a] - off[b] for i, a in enumerate(views) for b in views[i + 1:]]
        if own_errors:
            per_flight.append(float(np.median(np.abs(own_errors))))
    angles, focal = [], []
    for view, entry in cameras.items():
        true = truth["cameras"][view]
        found = np.array(entry["ecef_from_camera"]["rotation"]).T
        right, down, forward = axes_of(true)
        angles.append([math.degrees(math.atan2(found[2] @ axis, found[2] @ forward)) for axis in (right, down)])
        focal.append(100 * (entry["k"][0][0] / true["focal_px"] - 1))
    worst = lambda values: float(np.max(np.abs(values))) if len(values) else None
    middle = lambda values: float(np.median(np.abs(values))) if len(values) else None
    errors, sds = np.array(errors), np.array(sds)
    print(json.dumps({
        "scenarios": len(per_flight), "ticks": len(errors),
        "clock_to_track_s": {"median": middle(to_track), "worst": worst(to_track), "stated": middle(deviations),
                             "worst_over_stated": worst(np.array(to_track) / np.maximum(deviations, 1e-9))},
        "clock_between_s": {"median": middle(between), "worst": worst(between)},
        "pan_tilt_deg": {"worst_pan": worst(np.array(angles)[:, 0]), "worst_tilt": worst(np.array(angles)[:, 1])},
        "focal_pct": {"median": middle(focal), "worst": worst(focal)},
        "labels_m": {"median": middle(errors), "p90": float(np.quantile(np.abs(errors), 0.9)), "worst_flight_median": max(per_flight),
                     "within_90": float(np.mean(np.abs(errors) < 1.645 * sds))},
    }, indent=1))


if __name__ == "__main__":
    if sys.argv[1] == "residuals":
        residuals(sys.argv[2:])
    elif sys.argv[1] == "make":
        folder, kind, seed, arrivals, cameras, rate = sys.argv[2:8]
        make(pathlib.Path(folder), kind, int(seed), int(arrivals), int(cameras), float(rate), "--calibrated" in sys.argv)
    else:
        judge(pathlib.Path(sys.argv[2]), pathlib.Path(sys.argv[3]))
