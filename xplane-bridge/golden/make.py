#!/usr/bin/env python3
"""Regenerates the golden packets of this folder: `python3 xplane-bridge/golden/make.py`.

Each packet is a `.bin` (the datagram) and a `.json` (its meaning). They are packed here with Python's `struct`, from the field
tables of Laminar's "Exchanging data with X-Plane" and not by the Rust code that they test, so that a mistake in one of the two
shows. Variants that real clients send (padding, missing NUL, odd fifth byte) are included; those cannot be encoded back, since we
send the plain form.
"""

import json
import pathlib
import struct

HERE = pathlib.Path(__file__).parent


def golden(name, direction, about, datagram, packet, encodes_back=True):
    """Writes one packet and its meaning."""
    (HERE / f"{name}.bin").write_bytes(datagram)
    meaning = {"about": about, "direction": direction, "encodes_back": encodes_back, "packet": packet}
    (HERE / f"{name}.json").write_text(json.dumps(meaning, indent=2) + "\n")


def to_simulator(name, about, datagram, packet, encodes_back=True):
    golden(name, "to_simulator", about, datagram, packet, encodes_back)


def from_simulator(name, about, datagram, packet, encodes_back=True):
    golden(name, "from_simulator", about, datagram, packet, encodes_back)


ZULU = b"sim/time/zulu_time_sec"
to_simulator(
    "rref_request", "subscribe at 20 Hz as number 7",
    struct.pack("<5sii400s", b"RREF", 20, 7, ZULU),
    {"subscribe_dataref": {"frequency_hz": 20, "index": 7, "path": ZULU.decode()}},
)
to_simulator(
    "rref_request_fifth_byte_0", "XPlaneConnectX: an ASCII 0 as fifth byte, [0] behind a scalar",
    struct.pack("<5sii400s", b"RREF0", 20, 7, ZULU + b"[0]"),
    {"subscribe_dataref": {"frequency_hz": 20, "index": 7, "path": ZULU.decode() + "[0]"}},
    encodes_back=False,
)
to_simulator(
    "rref_end_by_index", "xpudpc: end of a subscription by its number, the path left empty",
    struct.pack("<5sii400s", b"RREF", 0, 7, b""),
    {"subscribe_dataref": {"frequency_hz": 0, "index": 7, "path": ""}},
)
from_simulator(
    "rref_reply", "three values in one datagram",
    struct.pack("<5sifififx", b"RREF,", 7, 64800.5, 8, -0.25, -1, 3.0)[:29],
    {"dataref_values": {"values": [
        {"index": 7, "value": 64800.5}, {"index": 8, "value": -0.25}, {"index": -1, "value": 3.0}]}},
)
FULL = [(index, index / 4) for index in range(183)]
from_simulator(
    "rref_reply_full", "the most values that a datagram has",
    b"RREF," + b"".join(struct.pack("<if", index, value) for index, value in FULL),
    {"dataref_values": {"values": [{"index": index, "value": value} for index, value in FULL]}},
)
CLOUD_BASE = b"sim/weather/region/cloud_base_msl_m[1]"
to_simulator(
    "dref", "one element of an array, padded with NULs",
    struct.pack("<5sf500s", b"DREF", 1500.0, CLOUD_BASE),
    {"write_dataref": {"path": CLOUD_BASE.decode(), "value": 1500.0}},
)
to_simulator(
    "dref_spaces", "a path ended by NUL, then padded with spaces",
    struct.pack("<5sf500s", b"DREF0", 1500.0, (CLOUD_BASE + b"\0").ljust(500)),
    {"write_dataref": {"path": CLOUD_BASE.decode(), "value": 1500.0}},
    encodes_back=False,
)
PAUSE = b"sim/operation/pause_on"
to_simulator("cmnd", "a command with its NUL", b"CMND\0" + PAUSE + b"\0", {"command": {"path": PAUSE.decode()}})
to_simulator(
    "cmnd_unterminated", "a command without NUL", b"CMND\0" + PAUSE,
    {"command": {"path": PAUSE.decode()}}, encodes_back=False,
)
to_simulator(
    "cmnd_padded", "a command padded to 505 bytes", struct.pack("<5s500s", b"CMND", PAUSE),
    {"command": {"path": PAUSE.decode()}}, encodes_back=False,
)
to_simulator("rpos_request", "the frequency in characters", b"RPOS\x0060\0", {"subscribe_position": {"frequency_hz": 60}})
to_simulator(
    "rpos_request_padded", "the same, padded to 10", b"RPOS\x0060".ljust(15, b"\0"),
    {"subscribe_position": {"frequency_hz": 60}}, encodes_back=False,
)
from_simulator(
    "rpos_reply", "longitude first; pitch, heading, roll; rates in radians per second",
    struct.pack(
        "<5s3d10f", b"RPOS", 103.912427524, 1.194827667, 762.0085,
        755.25, 5.25, 23.0, -0.5, 37.5, -4.0, -88.25, 0.125, -0.25, 0.5),
    {"position": {
        "longitude_deg": 103.912427524, "latitude_deg": 1.194827667, "elevation_msl_m": 762.0085,
        "height_agl_m": 755.25, "pitch_deg": 5.25, "heading_true_deg": 23.0, "roll_deg": -0.5,
        "velocity_east_mps": 37.5, "velocity_up_mps": -4.0, "velocity_south_mps": -88.25,
        "roll_rate_rad_s": 0.125, "pitch_rate_rad_s": -0.25, "yaw_rate_rad_s": 0.5}},
)
to_simulator(
    "prel", "start at latitude, longitude, elevation",
    struct.pack("<5sii8sii5d", b"PREL", 6, 0, b"WSSS", 0, 0, 1.194827667, 103.912427524, 762.0085, 23.0, 80.5),
    {"place_at_start": {
        "start_type": 6, "plane": 0, "airport": "WSSS", "runway": 0, "runway_end": 0, "latitude_deg": 1.194827667,
        "longitude_deg": 103.912427524, "elevation_msl_m": 762.0085, "heading_true_deg": 23.0, "speed_mps": 80.5}},
)
ACF = b"Aircraft/Laminar Research/Boeing 737-800/b738.acf"
to_simulator(
    "acfn", "an aircraft and its second livery",
    struct.pack("<5si150s2xi", b"ACFN", 0, ACF, 1),
    {"load_aircraft": {"plane": 0, "path": ACF.decode(), "livery": 1}},
)
BEACON = {"major": 1, "minor": 2, "host": 1, "version": 120400, "role": 1, "port": 49000}
BEACON_FIXED = struct.pack("<5sBBiiIH", b"BECN", 1, 2, 1, 120400, 1, 49000)
from_simulator(
    "becn", "with a name", BEACON_FIXED + b"tower\0" + struct.pack("<H", 49010),
    {"beacon": {**BEACON, "name": "tower", "raknet_port": 49010}},
)
from_simulator(
    "becn_nameless", "X-Plane 12 may send an empty name", BEACON_FIXED + b"\0" + struct.pack("<H", 49010),
    {"beacon": {**BEACON, "name": None, "raknet_port": 49010}},
)
from_simulator(
    "becn_short", "ends behind the port", BEACON_FIXED,
    {"beacon": {**BEACON, "name": None, "raknet_port": None}}, encodes_back=False,
)


def link(name, about, header, payload=b""):
    """Writes one message of the capture link: two lengths, the header, the payload."""
    text = json.dumps(header, separators=(",", ":")).encode()
    golden(
        name, "capture_link", about, struct.pack("<II", len(text), len(payload)) + text + payload,
        {"header": header, "payload_bytes": len(payload)}, encodes_back=False,
    )


POSE = {
    "latitude_deg": 1.194827667, "longitude_deg": 103.912427524, "altitude_msl_m": 762.0085,
    "heading_true_deg": 23.0214, "pitch_deg": 5.2327, "roll_deg": -0.002,
}
RUNWAY = {
    "airport": "WSSS", "name": "02L",
    "threshold": {"latitude_deg": 1.34897196, "longitude_deg": 103.97750124, "altitude_msl_m": 6.71},
    "course_true_deg": 23.02, "glide_path_deg": 3.0, "touchdown_past_threshold_m": 340.1,
    "ils_frequency_mhz": 110.9, "course_magnetic_deg": None,
}
link("link_hello", "the first message of the client", {"message": "hello", "client": "dtd 0.1.0"})
link(
    "link_hello_token", "the same, to a link that is open to other machines",
    {"message": "hello", "client": "dtd 0.1.0", "token": "sesame"},
)
link(
    "link_hello_answer", "who serves the link, and where pictures can come from",
    {
        "message": "hello", "name": "X-Plane", "version": "11.55", "plugin": "dtd_bridge 0.1.0", "pixels": ["gl", "screen"],
        "window": {"title": "X-System", "x_px": -1920, "y_px": 24, "width_px": 1920, "height_px": 1280, "scale": 1.5},
    },
)
link(
    "link_hello_answer_size", "the same, of a plugin that knows how large its window is, but not where it lies",
    {
        "message": "hello", "name": "X-Plane", "version": "12.4.0", "plugin": "dtd_bridge 0.1.0", "pixels": ["screen"],
        "window": None, "drawn_size": {"width_px": 1920, "height_px": 1280},
    },
)
link("link_freeze", "stand still around a runway", {"message": "freeze", "runway": RUNWAY, "settle_frames": 3})
link("link_check_pattern", "draw the check pattern with a code", {"message": "check_pattern", "code": 3735928559})
link(
    "link_check_pattern_under", "draw it under the windows of the user interface",
    {"message": "check_pattern", "code": 3735928559, "under": True},
)
link("link_check_pattern_none", "take it away", {"message": "check_pattern", "code": None})
link("link_check_pattern_shown", "the answer to both", {"message": "check_pattern_shown", "sim_frame": 4712})
link(
    "link_fly", "fly an approach from where the simulator has started it already",
    {
        "message": "fly",
        "start": {
            "position": {"latitude_deg": 1.194827667, "longitude_deg": 103.912427524, "altitude_msl_m": 762.0085},
            "heading_true_deg": 23.0214, "speed_mps": 82.3},
        "runway": RUNWAY, "profile": {"kind": "glide_path", "level_altitude_msl_m": 762.0}, "seed": 18446744073709551615,
        "time_limit_s": 900.5, "already_started": True,
    },
)
FLIGHT_ROW = [0.0, 1.25, 103.5, 700.25, 23.0, 2.5, -0.5, 70.0, 30.0, 4.0, 76.25, 0.5, 1.0, 0.0]
link(
    "link_flown", "a flight of two states of 14 64-bit floats",
    {
        "message": "flown", "columns": [
            "time_s", "latitude_deg", "longitude_deg", "altitude_msl_m", "heading_true_deg", "pitch_deg", "roll_deg",
            "velocity_north_mps", "velocity_east_mps", "velocity_down_mps", "true_airspeed_mps", "flap_ratio",
            "gear_ratio", "on_ground"],
        "rows": 2,
    },
    struct.pack("<14d", *FLIGHT_ROW) + struct.pack("<14d", 0.125, *FLIGHT_ROW[1:-1], 1.0),
)
link("link_command", "do a command exactly once", {"message": "command", "path": "sim/operation/regen_weather"})
link("link_release", "let everything run", {"message": "release"})
link(
    "link_capture", "one view of one tick",
    {
        "message": "capture", "tick": 12, "time_ns": 400000000, "view": 1, "pose": POSE,
        "controls": {"flap_ratio": 0.25, "gear_ratio": 1.0}, "camera": {**POSE, "hfov_deg": 10.0},
        "width_px": 4, "height_px": 2, "deliver": "picture",
    },
)
link(
    "link_frame", "its answer: what was drawn, and 4 x 2 pixels of 3 bytes",
    {
        "message": "frame", "tick": 12, "view": 1, "sim_frame": 4711, "pose": POSE,
        "camera": {**POSE, "hfov_deg": 10.0}, "width_px": 4, "height_px": 2,
    },
    bytes(range(24)),
)
link("link_error", "what the simulator says when it cannot", {"message": "error", "text": "no runway: freeze first"})
