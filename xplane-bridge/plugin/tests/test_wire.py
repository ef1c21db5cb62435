"""The golden messages decode to the same as in Rust; broken ones are rejected with the reason."""

import paths  # noqa: F401

import io
import json
import struct
import unittest

from dtd_bridge import check_pattern, messages, wire
from dtd_bridge.flight import COLUMNS


def reader(data: bytes):
    stream = io.BytesIO(data)

    def read_exactly(count: int) -> bytes:
        got = stream.read(count)
        if len(got) < count:
            raise EOFError
        return got

    return read_exactly


def golden(name: str) -> tuple[dict, bytes]:
    return wire.read_message(reader((paths.GOLDEN / f"{name}.bin").read_bytes()))


class Wire(unittest.TestCase):
    def test_every_golden_message_is_read_as_its_json_says_and_packed_to_the_same_bytes(self):
        found = sorted(paths.GOLDEN.glob("link_*.bin"))
        self.assertGreater(len(found), 12)
        for path in found:
            with self.subTest(path.name):
                meaning = json.loads(path.with_suffix(".json").read_text())["packet"]
                header, payload = wire.read_message(reader(path.read_bytes()))
                self.assertEqual(header, meaning["header"])
                self.assertEqual(len(payload), meaning["payload_bytes"])
                self.assertEqual(wire.pack(header, payload), path.read_bytes())

    def test_requests_are_understood(self):
        capture = messages.capture(golden("link_capture")[0])
        self.assertEqual((capture.tick, capture.view, capture.hfov_deg, capture.deliver), (12, 1, 10.0, "picture"))
        self.assertEqual(capture.pose.latitude_deg, 1.194827667)
        fly = messages.fly(golden("link_fly")[0])
        self.assertTrue(fly.already_started)
        self.assertEqual(fly.runway.ils_frequency_mhz, 110.9)
        self.assertIsNone(fly.runway.course_magnetic_deg)
        self.assertEqual(golden("link_flown")[0]["columns"], list(COLUMNS))

    def test_a_request_with_a_wrong_value_is_refused_by_its_name(self):
        good = golden("link_capture")[0]
        for key, value in [
            ("tick", -1), ("width_px", 0), ("width_px", 9_000), ("height_px", 2.5), ("deliver", "mail"), ("pose", None),
            ("view", True),
        ]:  # fmt: skip
            with self.subTest(key), self.assertRaisesRegex(messages.Refusal, key):
                messages.capture({**good, key: value})
        with self.assertRaisesRegex(messages.Refusal, "latitude_deg"):
            messages.capture({**good, "pose": {**good["pose"], "latitude_deg": 91}})
        with self.assertRaisesRegex(messages.Refusal, "hfov_deg"):
            messages.capture({**good, "camera": {**good["camera"], "hfov_deg": 180}})

    def test_a_start_or_a_runway_in_space_is_refused_by_its_name(self):
        good = golden("link_fly")[0]
        start, runway = good["start"], good["runway"]
        position = start["position"]
        self.assertEqual(messages.start({**start, "position": {**position, "altitude_msl_m": 30_000}}).pose.altitude_msl_m, 30_000)
        for place in ({"altitude_msl_m": 30_001}, {"altitude_msl_m": 1e12}, {"latitude_deg": 90.1}, {"longitude_deg": 1e9}):
            key = next(iter(place))
            with self.subTest(place), self.assertRaisesRegex(messages.LastingRefusal, key):
                messages.start({**start, "position": {**position, **place}})
        for changes in (
            {"start": {**start, "heading_true_deg": 1e300}},
            {"runway": {**runway, "touchdown_past_threshold_m": 1e7}},
            {"runway": {**runway, "ils_frequency_mhz": 1e30}},
            {"profile": {"kind": "glide_path", "level_altitude_msl_m": 1e12}},
            {"profile": {"kind": "step_down", "upper_altitude_msl_m": 900, "lower_altitude_msl_m": -1e9, "step_from_threshold_m": 9_000}},
        ):
            with self.subTest(changes), self.assertRaisesRegex(messages.LastingRefusal, "expected"):
                messages.fly({**good, **changes})

    def test_broken_bytes_are_refused(self):
        for data, words in [
            (b"\xff" * 8, "header of 4294967295"),
            (struct.pack("<II", 2, 0xFFFFFFFF) + b"{}", "payload of 4294967295"),
            (struct.pack("<II", 2, 0) + b"{}", "no object with a message"),
            (struct.pack("<II", 2, 0) + b"\xff\xfe", "not JSON"),
        ]:
            with self.assertRaisesRegex(wire.WireError, words):
                wire.read_message(reader(data))
        with self.assertRaisesRegex(wire.WireError, "version 7"):
            wire.check_greeting(b"DTDL\x07\0\0\0")
        with self.assertRaisesRegex(wire.WireError, "greets"):
            wire.check_greeting(b"HTTP/1.1")

    def test_no_number_that_json_lacks_is_sent(self):
        with self.assertRaises(ValueError):
            wire.pack({"message": "terrain", "elevation_msl_m": float("nan")})


class CheckPattern(unittest.TestCase):
    def test_its_rectangles_are_the_golden_ones(self):
        patterns = json.loads((paths.GOLDEN / "check_pattern.json").read_text())["patterns"]
        self.assertGreater(len(patterns), 1)
        for pattern in patterns:
            found = check_pattern.rectangles(pattern["code"], pattern["width_px"], pattern["height_px"])
            wanted = [
                (f["left_px"], f["top_px"], f["right_px"], f["bottom_px"], tuple(f["rgb"])) for f in pattern["fill"]
            ]
            self.assertEqual(list(found), wanted)


if __name__ == "__main__":
    unittest.main()
