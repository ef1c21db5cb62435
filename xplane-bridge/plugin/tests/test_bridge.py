"""The whole plugin against the in-memory fake ``xp``, over real sockets: captures, disturbances, flights, rejections."""

import paths  # noqa: F401

import errno
import importlib
import math
import socket
import struct
import sys
import tempfile
import time
import unittest
from pathlib import Path
from unittest import mock

from dtd_bridge import capture as capturing, flight as flying, found, log as dtd_log, scenery, server, wire
from dtd_bridge.bridge import Bridge
from dtd_bridge.profile import ProfileFile
from dtd_bridge.scenery import Ground
from dtd_bridge.settings import Settings, SettingsError, read_settings
from fake_xp import FakeGl, FakeXp, Kind
from paper_world import GROUND_MSL_M, PaperWorld
from xp_rules import BEFORE, DISABLE, ENABLE, MESSAGE, START, STOP

RUNWAY = {
    "airport": "WSSS", "name": "02L",
    "threshold": {"latitude_deg": 1.34897196, "longitude_deg": 103.97750124, "altitude_msl_m": 6.71},
    "course_true_deg": 23.02, "glide_path_deg": 3.0, "touchdown_past_threshold_m": 340.1,
    "ils_frequency_mhz": 110.9, "course_magnetic_deg": None,
}  # fmt: skip
FREEZE = {"message": "freeze", "runway": RUNWAY, "settle_frames": 3}
OVERRIDE = "sim/operation/override/override_planepath"
# Callbacks in the worst order, two cycles in a frame, starts that crash where X-Plane would.
QUIRKS = frozenset({
    "two_cycles_per_loop", "camera_callback_order", "draw_before_is_one", "camera_taken", "late_start_crashes",
})  # fmt: skip


def pose(latitude=1.3, longitude=103.95, altitude=400.0, heading=23.0, pitch=2.5, roll=-0.5):
    return {
        "latitude_deg": latitude, "longitude_deg": longitude, "altitude_msl_m": altitude,
        "heading_true_deg": heading, "pitch_deg": pitch, "roll_deg": roll,
    }  # fmt: skip


def capture(tick=0, deliver="picture", **changes):
    return {
        "message": "capture", "tick": tick, "time_ns": tick * 10**9, "view": 0, "pose": pose(latitude=1.3 + tick / 1000),
        "controls": {"flap_ratio": 0.5, "gear_ratio": 1.0},
        "camera": {**pose(1.36, 103.98, 16.7, 203.0, 1.6, 0.0), "hfov_deg": 10.0},
        "width_px": 64, "height_px": 48, "deliver": deliver, **changes,
    }  # fmt: skip


class Client:
    """A client over a real socket, in the test's own thread; the simulator runs a frame whenever it waits."""

    def __init__(self, bridge: Bridge, xp: FakeXp) -> None:
        self.xp, self.bridge = xp, bridge
        self.stream = socket.create_connection(("127.0.0.1", bridge.port))
        self.stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.stream.settimeout(0.001)
        self.stream.sendall(wire.GREETING)
        self.buffer = b""
        self.greeting = self.take(8)

    def send(self, header):
        self.stream.sendall(wire.pack(header))

    def take(self, count):
        for _ in range(20_000):
            if len(self.buffer) >= count:
                taken, self.buffer = self.buffer[:count], self.buffer[count:]
                return taken
            try:
                got = self.stream.recv(1 << 20)
                if not got:
                    raise EOFError
                self.buffer += got
            except TimeoutError:
                self.bridge.step_in_frame()
        raise AssertionError("no answer after 20000 frames")

    def receive(self):
        return wire.read_message(self.take)

    def ask(self, header):
        self.send(header)
        return self.receive()

    def refused(self, header):
        answer, _ = self.ask(header)
        assert answer["message"] == "error", answer
        return answer["text"]


class WithBridge(unittest.TestCase):
    def setUp(self):
        self.world = PaperWorld()
        self.xp = xp = FakeXp(self.world, QUIRKS)
        self.addCleanup(lambda: self.assertEqual(xp.misplaced, [], "called from a place where X-Plane does not allow it"))
        # Scenery is there at once unless a test says otherwise.
        self.patch(scenery, HOLD_S=0.0, PROBE_GAP_S=0.0)
        self.gl = FakeGl(self.xp)
        self.bridge = None
        self.profile = None

    def patch(self, module, **values):
        for name, value in values.items():
            self.addCleanup(setattr, module, name, getattr(module, name))
            setattr(module, name, value)

    def start(self, **settings):
        with self.xp.inside(ENABLE):
            self.bridge = Bridge(self.xp, Settings(port=0, **settings), self.gl, self.profile)
        self.bridge.step_in_frame = self.xp.frame
        self.addCleanup(self.close, self.xp, self.bridge)
        return self.another()

    @staticmethod
    def close(xp, bridge):
        with xp.inside(DISABLE):
            bridge.close()

    def another(self):
        client = Client(self.bridge, self.xp)
        self.addCleanup(client.stream.close)
        return client

    def frozen(self):
        client = self.start()
        self.assertEqual(client.ask({"message": "hello", "client": "test"})[0]["message"], "hello")
        self.assertEqual(client.ask(FREEZE)[0], {"message": "frozen"})
        return client

    def near(self, found, wanted, metres=0.01, degrees=0.0002):
        for key in ("latitude_deg", "longitude_deg"):
            self.assertAlmostEqual(found[key], wanted[key], delta=metres / 111_000, msg=key)
        self.assertAlmostEqual(found["altitude_msl_m"], wanted["altitude_msl_m"], delta=metres)
        for key in ("heading_true_deg", "pitch_deg", "roll_deg"):
            self.assertAlmostEqual(found[key], wanted[key], delta=degrees, msg=key)


class Greeting(WithBridge):
    def test_hello_says_who_serves_and_where_pictures_come_from(self):
        client = self.start()
        self.assertEqual(client.greeting, wire.GREETING)
        answer, payload = client.ask({"message": "hello", "client": "test"})
        self.assertEqual((answer["name"], answer["version"], payload), ("X-Plane", "11.55", b""))
        self.assertEqual((answer["pixels"], answer["window"]), (["gl", "screen"], None))

    def test_versions_are_those_of_x_planes_own_log(self):
        for number, text in [(115_202, "11.52"), (120_403, "12.0.4"), (121_407, "12.1.4"), (124_311, "12.4.3")]:
            self.setUp()
            self.world.set("sim/version/xplane_internal_version", 0, number)
            answer, _ = self.start().ask({"message": "hello", "client": "test"})
            self.assertEqual(answer["version"], text)

    def test_a_command_is_done_once_and_an_unknown_one_is_refused(self):
        client = self.start()
        client.ask({"message": "hello", "client": "test"})
        answer, _ = client.ask({"message": "command", "path": "sim/operation/regen_weather"})
        self.assertEqual((answer, self.world.commands), ({"message": "commanded"}, ["sim/operation/regen_weather"]))
        self.assertRegex(client.refused({"message": "command", "path": "sim/no/such"}), "sim/no/such")

    def test_only_what_would_be_refused_again_is_said_to_repeat(self):
        client = self.frozen()
        for request in [
            {"message": "command", "path": "sim/no/such"},
            {"message": "dance"},
            capture(tick=-1),
        ]:
            with self.subTest(request):
                answer, _ = client.ask(request)
                self.assertEqual(answer["message"], "error")
                self.assertTrue(answer["repeats"])
        late = self.another()
        self.assertNotIn("repeats", late.ask({"message": "hello", "client": "late"})[0])

    def test_the_size_of_the_window_is_told_although_its_place_is_not_known(self):
        self.world.values["sim/graphics/view/window_width"] = [96.0]
        client = self.start()
        answer, _ = client.ask({"message": "hello", "client": "test"})
        self.assertIsNone(answer["window"])
        self.assertEqual(answer["drawn_size"], {"width_px": 96, "height_px": 48})

    def test_a_client_on_another_computer_is_told_how_it_gets_at_the_screen_and_one_here_is_not(self):
        self.assertNotIn("screen", self.start().ask({"message": "hello", "client": "test"})[0])
        with mock.patch("dtd_bridge.server.Connection.comes_from_elsewhere", return_value=True):
            answer, _ = self.start().ask({"message": "hello", "client": "test"})
        self.assertRegex(answer["screen"]["refused"], "grab = on")

    def test_x_plane_12_and_vulkan_have_no_readback_and_say_so(self):
        for name, value in [
            ("sim/version/xplane_internal_version", 120_400), ("sim/graphics/view/using_modern_driver", 1),
        ]:  # fmt: skip
            self.setUp()
            self.world.set(name, 0, value)
            client = self.frozen()
            self.assertEqual(client.ask({"message": "hello", "client": "test"})[0]["pixels"], ["screen"])
            self.assertRegex(client.refused(capture()), "Vulkan or Metal.*--pixels screen")
            self.assertEqual(client.ask(capture(deliver="drawn"))[0]["message"], "frame")

    def test_a_token_is_demanded_and_a_wrong_one_ends_the_connection(self):
        client = self.start(token="sesame")
        self.assertRegex(client.refused({"message": "hello", "client": "test", "token": "Sesame"}), "DTD_LINK_TOKEN")
        with self.assertRaises(EOFError):
            client.receive()
        again = self.another()
        self.assertEqual(again.ask({"message": "hello", "client": "test", "token": "sesame"})[0]["message"], "hello")

    def test_a_second_client_is_told_that_the_seat_is_taken(self):
        first = self.frozen()
        second = self.another()
        self.assertRegex(second.refused({"message": "hello", "client": "late"}), "another client")
        self.assertEqual(first.ask(capture())[0]["message"], "frame")

    def test_nothing_is_drawn_for_a_client_that_takes_no_answers(self):
        client = self.frozen()
        self.patch(server, MAX_QUEUED_BYTES=0)
        client.send(capture())
        for _ in range(50):
            self.xp.frame()
        self.assertEqual(self.world.rendered, [])
        self.patch(server, MAX_QUEUED_BYTES=1 << 20)
        self.assertEqual(client.receive()[0]["message"], "frame")

    def test_what_cannot_be_understood_is_said_and_the_link_goes_on(self):
        client = self.frozen()
        self.assertRegex(client.refused({"message": "dance"}), "dance")
        self.assertRegex(client.refused(capture(width_px=0)), "width_px")
        self.assertEqual(client.ask(capture())[0]["message"], "frame")


class Profiles(WithBridge):
    def hello(self, client):
        return client.ask({"message": "hello", "client": "test"})[0]

    def test_a_profile_lies_beside_the_plugin_and_comes_with_every_hello(self):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "dtd_profile.json"
            self.profile = ProfileFile(path)
            client = self.start()
            self.assertNotIn("profile", self.hello(client))
            profile = {"format": 1, "still_pictures_move": {"found": True}}
            self.assertEqual(client.ask({"message": "keep_profile", "profile": profile})[0], {"message": "profile_kept"})
            self.assertEqual([item.name for item in Path(folder).iterdir()], ["dtd_profile.json"])
            self.assertEqual(self.hello(client)["profile"], profile)
            # Motion in a pause is not waited for.
            self.assertTrue(self.bridge._pixels.restless)
            client.ask({"message": "keep_profile", "profile": {}})
            self.assertFalse(self.bridge._pixels.restless)
            path.write_text("{")
            self.assertNotIn("profile", self.hello(client))
            self.profile._path = Path(folder) / "no" / "such.json"
            self.assertRegex(client.refused({"message": "keep_profile", "profile": profile}), "such.json.*writable")

    def test_a_profile_may_have_16_kib_as_it_is_sent_and_not_a_byte_more(self):
        with tempfile.TemporaryDirectory() as folder:
            self.profile = ProfileFile(Path(folder) / "dtd_profile.json")
            client = self.start()
            self.hello(client)
            around = len(wire.encode({"text": ""}))
            longest = {"text": "x" * (16_384 - around)}
            self.assertEqual(client.ask({"message": "keep_profile", "profile": longest})[0], {"message": "profile_kept"})
            self.assertEqual(self.hello(client)["profile"], longest)
            for beyond in (longest["text"] + "x", "x" * 65_000, "é" * 20_000):
                refused = client.refused({"message": "keep_profile", "profile": {"text": beyond}})
                self.assertRegex(refused, "expected at most 16384")
            self.assertEqual(self.hello(client)["profile"], longest)

    def test_what_is_no_json_to_every_client_is_no_request_and_the_next_client_is_served(self):
        with tempfile.TemporaryDirectory() as folder:
            self.profile = ProfileFile(Path(folder) / "dtd_profile.json")
            client = self.start()
            for value in ("NaN", "-Infinity", "1e999", '"\\ud800"', '{"\\udfff":1}', "1" * 30, "[" * 40 + "]" * 40):
                with self.subTest(value):
                    self.hello(client)
                    text = f'{{"message":"keep_profile","profile":{{"text":{value}}}}}'.encode()
                    client.stream.sendall(struct.pack("<II", len(text), 0) + text)
                    answer, _ = client.receive()
                    self.assertRegex(answer["text"], "not JSON")
                    client = self.another()
            self.assertNotIn("profile", self.hello(client))

    def test_a_profile_on_disk_that_no_hello_could_contain_is_dropped_at_the_start_and_the_log_says_so(self):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "dtd_profile.json"
            for text in ('{"clouds_take_s": NaN}', '{"text": "\\ud800"}', '{"text": "%s"}' % ("x" * 65_400), "{", "[]"):
                with self.subTest(text[:30]):
                    self.setUp()
                    path.write_text(text)
                    self.profile = ProfileFile(path)
                    client = self.start()
                    self.assertFalse(path.exists())
                    self.assertRegex("\n".join(self.xp.lines), "the profile in .* is not used: .*dtd doctor")
                    self.assertNotIn("profile", self.hello(client))
            path.write_text('{"format": 1}')
            self.setUp()
            self.profile = ProfileFile(path)
            self.assertEqual(self.hello(self.start())["profile"], {"format": 1})

    def test_a_sound_profile_that_cannot_be_opened_once_stays(self):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "dtd_profile.json"
            path.write_text('{"format": 1}')
            for number in (errno.EMFILE, errno.EIO, errno.EACCES, errno.ESTALE):
                with self.subTest(errno.errorcode[number]):
                    with mock.patch.object(Path, "open", side_effect=OSError(number, "once")):
                        said = ProfileFile(path).drop_if_unusable()
                    self.assertIn("is not used", said)
                    self.assertTrue(path.exists())
            self.assertIsNone(ProfileFile(path).drop_if_unusable())

    def test_an_error_does_not_quote_all_of_a_long_request(self):
        client = self.start()
        self.hello(client)
        self.assertLess(len(client.refused({"message": "é" * 20_000})), 2_001)
        self.assertEqual(self.hello(client)["message"], "hello")

    def test_clients_that_come_and_go_are_logged_once_a_minute_and_counted(self):
        times = [1_000.0]
        with mock.patch.object(dtd_log.time, "monotonic", side_effect=lambda: times[0]):
            lines = dtd_log.ClientLines(self.xp)
            for _ in range(1_000):
                lines.say("note", "127.0.0.1", "capture link closed")
            lines.say("note", "10.0.0.7", "capture link closed")
            times[0] += 60.0
            lines.say("note", "127.0.0.1", "capture link closed")
        closed = [line for line in self.xp.lines if "capture link closed" in line]
        self.assertEqual(closed, ["capture link closed"] * 2 + ["capture link closed (999 more of these in the last 60 s)"])


class Capturing(WithBridge):
    def test_what_was_drawn_is_read_back_and_is_what_was_asked(self):
        client = self.frozen()
        answer, picture = client.ask(capture(7))
        self.assertEqual((answer["tick"], answer["view"], len(picture)), (7, 0, 64 * 48 * 3))
        self.near(answer["pose"], capture(7)["pose"], degrees=0.001)
        self.near(answer["camera"], capture(7)["camera"])
        # Read back from 32 bits, not copied.
        self.assertNotEqual(answer["camera"]["latitude_deg"], capture(7)["camera"]["latitude_deg"])
        # Upright: red grows to the right, green downwards; blue encodes the aircraft's position. No window covers it.
        self.assertEqual((picture[0], picture[1], picture[2]), (0, 0, self.world.colour()))
        self.assertEqual(picture[3 * 63], 63)
        self.assertEqual(picture[3 * 64 * 47 + 1], 47)

    def test_so_many_frames_settle_before_the_one_that_counts(self):
        client = self.frozen()
        first = client.ask(capture(0))[0]["sim_frame"]
        client.send(capture(1))
        client.send(capture(2))
        frames = [client.receive()[0]["sim_frame"] for _ in range(2)]
        self.assertGreater(frames[0], first + 3)
        # Requested ahead, the second follows at once: three that settle, one more, and the one that is the same again.
        self.assertIn(frames[1] - frames[0], (5, 6))

    def test_a_picture_that_still_shows_the_tick_before_is_not_taken_for_the_new_one(self):
        for lag_frames in range(3, 9):
            with self.subTest(lag_frames=lag_frames):
                self.setUp()
                self.world.lag_frames = lag_frames
                client = self.frozen()
                for tick in range(3):
                    _, picture = client.ask(capture(tick))
                    self.assertEqual(picture[2], self.world.colour(), tick)

    def test_pictures_that_move_by_themselves_are_waited_for_as_long_as_any_x_plane_has_shown_the_tick_before(self):
        clock = {"day_of_year": 172, "zulu_time_s": 14_400.0}
        for restless, running in ((False, {"running_at": clock}), (True, {})):
            with self.subTest(restless=restless):
                self.setUp()
                self.world.rains, self.world.lag_frames = True, 4
                client = self.start()
                client.ask({"message": "hello", "client": "test"})
                client.ask({**FREEZE, **running})
                self.bridge._pixels.restless = restless
                for tick in range(1, 4):
                    _, picture = client.ask(capture(tick))
                    self.assertEqual(picture[2], self.world.colour(), tick)

    def test_a_tick_that_looks_like_the_one_before_is_taken_all_the_same(self):
        client = self.frozen()
        first = client.ask(capture(0))[1]
        self.assertEqual(client.ask(capture(0, camera={**capture()["camera"], "hfov_deg": 11.0}))[1], first)

    def test_pictures_that_never_stand_still_are_waited_for_once(self):
        client = self.frozen()
        self.world.colour = lambda: self.world.cycle % 256
        took = []
        for tick in range(3):
            before = self.xp.cycle
            client.ask(capture(tick))
            took.append((self.xp.cycle - before) // 2)
        self.assertGreater(took[0], capturing.RESTLESS_FRAMES)
        self.assertLess(max(took[1:]), capturing.RESTLESS_FRAMES)
        self.assertIn("no two images in a row agree", "\n".join(self.xp.lines))

    def test_the_view_is_external_before_the_camera_is_taken_and_while_pictures_are(self):
        client = self.frozen()
        client.ask(capture(0))
        self.assertEqual(self.world.commands.count("sim/view/free_camera"), 1)
        # Somebody looks into the cockpit in between: no such frame counts.
        self.world.command("sim/view/3d_cockpit")
        answer, _ = client.ask(capture(1))
        self.near(answer["camera"], capture(1)["camera"])
        self.assertEqual(self.world.commands.count("sim/view/free_camera"), 2)
        self.assertEqual(self.world.get("sim/graphics/view/view_is_external"), 1)

    def test_a_frame_that_somebody_replaces_while_it_is_grabbed_is_reported(self):
        def takes_the_camera():
            self.xp.steal_camera()

        def looks_into_the_cockpit():
            self.world.command("sim/view/3d_cockpit")

        def pauses_no_more():
            self.world.set("sim/time/paused", 0, 0)

        for takes_it_away in (takes_the_camera, looks_into_the_cockpit, pauses_no_more):
            with self.subTest(takes_it_away=takes_it_away):
                self.setUp()
                client = self.frozen()
                self.assertFalse(client.ask({"message": "still_shown"})[0]["still"])
                client.ask(capture(0, deliver="drawn"))
                self.assertEqual(client.ask({"message": "still_shown"})[0], {"message": "shown", "still": True})
                takes_it_away()
                # The camera is taken back meanwhile, which makes no earlier frame a right one.
                for _ in range(3):
                    self.assertEqual(client.ask({"message": "still_shown"})[0]["still"], False)

    def test_a_cockpit_that_does_not_go_away_ends_with_a_reason(self):
        self.patch(capturing, TIME_LIMIT_S=0.2)
        self.world.known_commands -= {"sim/view/free_camera"}
        self.assertRegex(self.frozen().refused(capture()), "cockpit.*choose an outside view")

    def test_both_angles_of_view_are_set_by_the_tangent_and_read_back(self):
        client = self.frozen()
        client.ask(capture(camera={**capture()["camera"], "hfov_deg": 60.0}))
        self.assertEqual(self.world.get("sim/graphics/settings/non_proportional_vertical_FOV"), 1)
        vertical = 2 * math.degrees(math.atan(math.tan(math.radians(30)) * 48 / 64))
        self.assertAlmostEqual(self.world.get("sim/graphics/view/vertical_field_of_view_deg"), vertical, places=4)
        # Somebody who turns it back.
        self.world.disturb = lambda world: world.set("sim/graphics/view/vertical_field_of_view_deg", 0, 30.0)
        self.world.kinds["sim/graphics/view/vertical_field_of_view_deg"] = Kind("float", None, False)
        self.bridge._datarefs._known.clear()
        self.assertRegex(client.refused(capture(1)), "vertical field of view is 30")

    def test_rain_falls_because_time_runs_and_the_clock_is_set_back_in_every_frame(self):
        client = self.start()
        client.ask({"message": "hello", "client": "test"})
        running = {**FREEZE, "running_at": {"day_of_year": 172, "zulu_time_s": 14_400.0}}
        self.assertEqual(client.ask(running)[0], {"message": "frozen"})
        self.world.disturb = lambda world: world.set("sim/time/zulu_time_sec", 0, 14_400.5)
        answer, _ = client.ask(capture(2))
        self.near(answer["pose"], capture(2)["pose"], degrees=0.001)
        self.assertEqual((self.world.get("sim/time/paused"), self.world.get(OVERRIDE)), (0, 1))
        for name, value in [("zulu_time_sec", 14_400), ("local_date_days", 171), ("use_system_time", 0)]:
            self.assertEqual(self.world.get(f"sim/time/{name}"), value)
        for override in ("joystick", "flightcontrol", "throttles"):
            self.assertEqual(self.world.get(f"sim/operation/override/override_{override}"), 1)
        self.world.command("sim/operation/pause_on")
        self.assertRegex(client.refused(capture(3)), "rain does not fall")

    def test_other_aircraft_pop_ups_and_the_cross_are_gone_and_a_replay_is_a_reason(self):
        self.world.others = True
        client = self.frozen()
        self.assertFalse(self.world.others)
        self.assertEqual(self.world.values["sim/cockpit2/radios/indicators/show_popup"], [0.0] * 4)
        self.assertEqual(self.world.get("sim/joystick/mouse_is_yoke"), 0)
        client.ask({"message": "release"})
        self.assertTrue(self.world.others)
        self.world.set("sim/time/is_in_replay", 0, 1)
        self.assertRegex(client.refused(FREEZE), "replay")

    def test_flaps_gear_and_field_of_view_are_written(self):
        client = self.frozen()
        client.ask(capture(controls={"flap_ratio": 0.625, "gear_ratio": 0.25}))
        self.assertEqual(self.world.get("sim/flightmodel/controls/flaprat"), 0.625)
        self.assertEqual(self.world.get("sim/aircraft/parts/acf_gear_deploy", 2), 0.25)
        self.assertEqual(self.world.get("sim/graphics/view/field_of_view_deg"), 10)

    def test_a_stolen_camera_is_taken_back_and_the_disturbed_frames_do_not_count(self):
        client = self.frozen()
        thefts = []

        def steal(world):
            if len(thefts) < 6 and world.cycle % 3 == 0:
                thefts.append(self.bridge._stage.frames)
                self.xp.steal_camera()

        self.world.disturb = steal
        answer, _ = client.ask(capture(3))
        self.assertEqual(len(thefts), 6)
        self.assertGreater(answer["sim_frame"], thefts[-1])
        self.near(answer["camera"], capture(3)["camera"])

    def test_a_camera_that_is_lost_while_the_screen_is_grabbed_is_taken_back_without_a_request(self):
        client = self.frozen()
        client.ask(capture(deliver="drawn"))
        self.xp.steal_camera()
        self.assertEqual(self.xp.isCameraBeingControlled(), 0)
        for _ in range(3):
            self.xp.frame()
        self.assertNotEqual(self.xp.isCameraBeingControlled(), 0)

    def test_a_camera_that_is_stolen_every_frame_ends_with_a_reason(self):
        client = self.frozen()
        self.world.disturb = lambda world: self.xp.steal_camera()
        self.patch(capturing, TIME_LIMIT_S=0.2)
        self.assertRegex(client.refused(capture()), "camera was not to be had")

    def test_a_moving_origin_does_not_move_the_picture(self):
        client = self.frozen()
        origins = [(1.0, 104.0), (1.4, 103.9), (1.1, 103.7), (1.3, 104.0)]

        def move(world):
            if world.cycle % 5 == 0:
                world.move_origin(*origins[world.cycle // 5 % len(origins)])

        self.world.disturb = move
        for tick in range(8):
            answer, _ = client.ask(capture(tick))
            self.near(answer["pose"], capture(tick)["pose"], degrees=0.001)
            self.near(answer["camera"], capture(tick)["camera"])

    def test_frames_while_scenery_loads_do_not_count(self):
        client = self.frozen()
        begin = self.bridge._stage.frames
        loading = "sim/graphics/scenery/async_scenery_load_in_progress"
        self.world.disturb = lambda world: world.set(loading, 0, float(self.bridge._stage.frames < begin + 40))
        self.assertGreaterEqual(client.ask(capture())[0]["sim_frame"], begin + 40 + 3)

    def test_a_window_of_another_shape_or_size_is_refused(self):
        client = self.frozen()
        self.assertRegex(client.refused(capture(width_px=64, height_px=40)), "shape")
        self.assertRegex(client.refused(capture(width_px=128, height_px=96)), "64x48 pixels, 128x96 are wanted")

    def test_nothing_is_captured_without_freeze_or_out_of_pause(self):
        client = self.start()
        client.ask({"message": "hello", "client": "test"})
        self.assertRegex(client.refused(capture()), "freeze first")
        client.ask(FREEZE)
        self.world.command("sim/operation/pause_off")
        self.assertRegex(client.refused(capture()), "taken out of its pause")

    def test_a_release_and_a_lost_client_give_everything_back(self):
        for leave in ("release", "close"):
            with self.subTest(leave):
                self.setUp()
                self.patch(found, COMES_BACK_WITHIN_S=0.05)
                before = {name: list(values) for name, values in self.world.values.items()}
                client = self.start()
                client.ask({"message": "hello", "client": "test"})
                # As the client does over UDP.
                for name in ("sim/weather/use_real_weather_bool", "sim/time/use_system_time"):
                    self.world.set(name, 0, 0)
                self.world.set(OVERRIDE, 0, 1)
                client.ask(FREEZE)
                client.ask(capture())
                if leave == "release":
                    self.assertEqual(client.ask({"message": "release"})[0], {"message": "released"})
                    self.assertEqual(self.world.get(OVERRIDE), 0)
                    self.assertEqual(self.world.get("sim/time/use_system_time"), 0, "the client may come back")
                # Like a process that is killed.
                client.stream.close()
                deadline = time.monotonic() + 10
                while self.world.get("sim/time/use_system_time") == 0 and time.monotonic() < deadline:
                    self.xp.frame()
                given_back = (
                    "sim/operation/override/", "sim/time/paused", "sim/time/use_system_time", "sim/weather/", "sim/joystick/",
                    "sim/graphics/view/field_of_view_deg", "sim/graphics/view/vertical_field", "sim/graphics/settings/",
                    "sim/graphics/view/view_is_external",
                )  # fmt: skip
                for name, values in before.items():
                    if name.startswith(given_back):
                        self.assertEqual(self.world.values[name], values, name)
                self.assertIsNone(self.xp._camera)

    def test_the_aircraft_is_put_back_to_where_it_stood(self):
        stood = [self.world.get(f"sim/flightmodel/position/local_{axis}") for axis in "xyz"]
        client = self.frozen()
        client.ask(capture())
        shown = [self.world.get(f"sim/flightmodel/position/local_{axis}") for axis in "xyz"]
        self.assertGreater(math.dist(stood, shown), 100.0)
        client.ask(FREEZE)
        client.ask({"message": "release"})
        found = [self.world.get(f"sim/flightmodel/position/local_{axis}") for axis in "xyz"]
        self.assertLess(math.dist(stood, found), 0.01)

    def test_a_client_that_comes_back_soon_finds_its_weather_and_what_was_found_first_is_given_back_last(self):
        self.patch(found, COMES_BACK_WITHIN_S=30.0)
        first = self.frozen()
        self.world.set("sim/time/use_system_time", 0, 0)
        first.ask({"message": "release"})
        first.stream.close()
        second = self.another()
        self.assertEqual(second.ask({"message": "hello", "client": "test"})[0]["message"], "hello")
        self.assertEqual(self.world.get("sim/time/use_system_time"), 0)
        with self.xp.inside(BEFORE):
            self.bridge._found.give_back_everything()
        self.assertEqual(self.world.get("sim/time/use_system_time"), 1)

    def test_an_x_plane_without_pause_on_is_paused_by_the_toggle(self):
        self.world.known_commands -= {"sim/operation/pause_on", "sim/operation/pause_off"}
        client = self.frozen()
        self.assertEqual(self.world.get("sim/time/paused"), 1)
        client.ask({"message": "release"})
        self.assertEqual(self.world.get("sim/time/paused"), 0)


class SettingUp(WithBridge):
    def test_the_check_pattern_is_drawn_over_the_window_and_captures_wait_for_its_end(self):
        client = self.frozen()
        answer, _ = client.ask({"message": "check_pattern", "code": 305419896})
        self.assertEqual(answer["message"], "check_pattern_shown")
        # From the bottom left: the first fill is the whole window, the third the cell that the golden pattern names.
        self.assertEqual(self.gl.filled[0], (0, 0, 64, 48, (255, 0, 255)))
        self.assertEqual(self.gl.filled[2], (25, 38, 32, 44, (255, 255, 255)))
        self.assertRegex(client.refused(capture()), "check pattern covers")
        client.ask({"message": "check_pattern", "code": None})
        count = len(self.gl.filled)
        self.assertEqual(client.ask(capture())[0]["message"], "frame")
        self.assertEqual(len(self.gl.filled), count)

    def test_the_check_pattern_is_drawn_before_the_windows_or_after_them(self):
        client = self.frozen()
        self.assertIs(client.ask({"message": "hello", "client": "test"})[0]["patterns_under"], True)
        for under, after_windows in [(True, 0.0), (False, 1.0), (True, 0.0)]:
            client.ask({"message": "check_pattern", "code": 305419896, "under": under})
            self.assertEqual({rectangle[7] for rectangle in self.xp.rectangles}, {after_windows})
        client.ask({"message": "check_pattern", "code": None})
        client.ask({"message": "check_pattern", "code": 7})
        self.assertEqual({rectangle[7] for rectangle in self.xp.rectangles}, {1.0})

    def test_windows_that_a_command_closes_are_closed_before_the_pattern_is_drawn_under_them(self):
        client = self.start()
        client.ask({"message": "hello", "client": "test"})
        pop_ups = "sim/cockpit2/radios/indicators/show_popup"
        self.world.known_commands.add("sim/operation/close_windows")
        for under, left in [(False, [1.0] * 4), (True, [0.0] * 4)]:
            self.world.values[pop_ups] = [1.0] * 4
            self.world.commands.clear()
            client.ask({"message": "check_pattern", "code": 7, "under": under})
            self.assertEqual(self.world.values[pop_ups], left)
            self.assertEqual("sim/operation/close_windows" in self.world.commands, under)

    def test_ground_is_probed_below_the_place_itself_far_from_the_origin_too(self):
        self.start()
        ground = Ground(self.xp)
        with self.xp.inside(BEFORE):
            for latitude, longitude in [(1.0, 104.0), (1.35, 103.98), (1.5, 103.6)]:
                self.assertAlmostEqual(ground.height_msl_m(latitude, longitude), GROUND_MSL_M, places=3)
            self.world.ground_is_loaded = False
            self.assertIsNone(ground.height_msl_m(1.0, 104.0))


class Flying(WithBridge):
    def fly(self, **changes):
        # 3 km before the threshold on a slope of 3 degrees.
        course = math.radians(23.02)
        start = {
            "latitude_deg": 1.34897196 - 3_000 * math.cos(course) / 110_575,
            "longitude_deg": 103.97750124 - 3_000 * math.sin(course) / 111_290,
            "altitude_msl_m": 6.71 + 3_340 * math.tan(math.radians(3)),
        }
        return {
            "message": "fly", "start": {"position": start, "heading_true_deg": 23.02, "speed_mps": 70.0},
            "runway": RUNWAY, "profile": {"kind": "glide_path", "level_altitude_msl_m": 200.0}, "seed": 1,
            "time_limit_s": 300.0, "already_started": False, **changes,
        }  # fmt: skip

    def begin(self):
        client = self.start()
        client.ask({"message": "hello", "client": "test"})
        return client

    def flown(self, client, **changes):
        """Flies; the rows of the log."""
        answer, payload = client.ask(self.fly(**changes))
        self.assertEqual(answer["message"], "flown", answer)
        return list(struct.iter_unpack("<14d", payload))

    def commands(self):
        return [path.rsplit("/", 1)[1] for path in self.world.commands]

    def followed(self):
        """Everything that flies the approach is on."""
        self.assertEqual(self.world.get("sim/cockpit/autopilot/autopilot_mode"), 2)
        self.assertEqual(self.world.get("sim/cockpit2/autopilot/autothrottle_enabled"), 1)
        for mode in ("nav", "glideslope", "approach"):
            self.assertTrue(self.world.status(mode), mode)

    def test_an_approach_is_started_in_the_air_logged_each_frame_and_ends_behind_the_touchdown(self):
        client = self.begin()
        self.world.disturb = lambda w: w.move_origin(1.2, 103.9) if w.cycle == 130 else None
        answer, payload = client.ask(self.fly())
        self.assertEqual(answer["message"], "flown", answer)
        rows = list(struct.iter_unpack("<14d", payload))
        self.assertEqual(len(rows), answer["rows"])
        self.assertGreater(len(rows), 150)
        first, last = rows[0], rows[-1]
        self.assertAlmostEqual(first[4], 23.02, delta=0.001)
        self.assertAlmostEqual(first[7], 70 * math.cos(math.radians(23.02)), delta=0.01)
        self.assertAlmostEqual(first[8], 70 * math.sin(math.radians(23.02)), delta=0.01)
        self.assertEqual((first[13], last[13]), (0.0, 1.0))
        self.assertEqual([b[0] - a[0] for a, b in zip(rows, rows[1:])], [0.25] * (len(rows) - 1))
        # It moved as fast as it says, also where the local origin jumped.
        for a, b in zip(rows[:-20], rows[1:-20]):
            north = (b[1] - a[1]) * 110_575
            self.assertAlmostEqual(north, a[7] * 0.25, delta=0.2)
        self.assertEqual(self.world.get("sim/cockpit/radios/nav1_freq_hz"), 11_090)
        self.assertEqual(self.world.get(OVERRIDE), 0)
        # Each once: a second time would switch it off again.
        self.assertEqual(
            self.commands(), ["fix_all_systems", "servos_on", "autothrottle_on", "NAV", "altitude_hold", "approach"]
        )
        self.followed()
        self.assertEqual(self.world.get("sim/cockpit2/controls/flap_ratio"), 0.75)
        self.assertEqual(self.world.get("sim/cockpit2/autopilot/airspeed_dial_kts"), 138)

    def test_modes_that_are_on_already_are_not_switched_off_again(self):
        for modes in (("nav",), ("nav", "glideslope", "approach"), ("glideslope", "altitude_hold")):
            with self.subTest(modes):
                self.setUp()
                for mode in modes:
                    self.world.set(f"sim/cockpit2/autopilot/{mode}_status", 0, 2)
                self.flown(self.begin())
                self.followed()

    def test_a_second_flight_lands_like_the_first_although_it_finds_everything_on(self):
        client = self.begin()
        first = self.flown(client)
        self.world.commands.clear()
        second = self.flown(client)
        self.followed()
        self.assertNotIn("servos_on", self.commands())
        self.assertAlmostEqual(len(first), len(second), delta=2)
        # Within a frame, 17 m.
        for key in (1, 2):
            self.assertAlmostEqual(first[-1][key], second[-1][key], delta=20 / 111_000)

    def test_the_glide_slope_that_the_last_flight_left_on_is_off_until_this_one_may_capture_it(self):
        client = self.begin()
        self.flown(client)
        step = {
            "kind": "step_down", "upper_altitude_msl_m": 200.0, "lower_altitude_msl_m": 180.0, "step_from_threshold_m": 2_500.0,
        }  # fmt: skip
        rows = self.flown(client, profile=step)
        # It flies level as long as the glide slope is off: 500 m at 70 m/s in steps of 0.25 s.
        level = [row for row in rows if row[3] > rows[0][3] - 1.0]
        self.assertAlmostEqual(len(level), 500 / (70 * 0.25), delta=4)
        self.followed()

    def test_an_autopilot_without_servos_is_a_reason_and_one_that_does_not_show_a_mode_is_logged(self):
        self.world.dead_buttons = {"servos_on"}
        self.assertRegex(self.begin().refused(self.fly()), "the servos on after sim/autopilot/servos_on: .*autopilot_mode is 0")
        self.setUp()
        self.world.dead_buttons = {"NAV"}
        self.flown(self.begin())
        self.assertEqual(self.commands().count("NAV"), 1)
        self.assertRegex("\n".join(self.xp.lines), "does not show the localizer on after sim/autopilot/NAV: .*nav_status is 0")
        self.followed()

    def test_the_engines_of_a_parked_aircraft_run_after_the_air_start_and_are_waited_for(self):
        self.flown(self.begin())
        running = [self.world.get("sim/flightmodel/engine/ENGN_running", engine) for engine in range(8)]
        self.assertEqual(running, [1, 1, 0, 0, 0, 0, 0, 0])
        self.setUp()
        import dtd_bridge.flight as module

        limit, module.ENGINES_LIMIT_S = module.ENGINES_LIMIT_S, 0.2
        self.addCleanup(setattr, module, "ENGINES_LIMIT_S", limit)
        self.world.dead_engines = {1}
        self.assertRegex(self.begin().refused(self.fly()), "of its 2 engines these do not run: 2")

    def test_a_pause_leaves_no_rows_and_no_gap(self):
        client = self.begin()
        followed = []

        def pause_once_it_follows(world):
            if world.status("approach"):
                followed.append(world.cycle)
            world.set("sim/time/paused", 0, float(30 <= len(followed) < 70))

        self.world.disturb = pause_once_it_follows
        rows = self.flown(client)
        self.assertGreater(len(followed), 70)
        self.assertEqual({b[0] - a[0] for a, b in zip(rows, rows[1:])}, {0.25})

    def test_a_flight_that_is_begun_anew_by_somebody_else_is_a_reason(self):
        client = self.begin()
        self.world.disturb = lambda w: w.cycle == 250 and w.set("sim/time/total_flight_time_sec", 0, 0)
        self.assertRegex(client.refused(self.fly()), "began another flight")

    def test_a_flight_that_does_not_land_in_time_or_not_here_is_given_up_with_its_place(self):
        client = self.begin()
        self.assertRegex(client.refused(self.fly(time_limit_s=5.0)), "not landed within 5 s")
        self.setUp()
        elsewhere = self.fly()
        elsewhere["start"]["position"]["latitude_deg"] += 0.2
        self.assertRegex(self.begin().refused(elsewhere), "came down -?[0-9]+ m before the threshold")

    def test_a_crash_is_a_reason(self):
        self.world.kinds["sim/flightmodel2/misc/has_crashed"] = Kind("int", None, False)
        self.world.values["sim/flightmodel2/misc/has_crashed"] = [0.0]
        client = self.begin()
        self.world.disturb = lambda w: w.set("sim/flightmodel2/misc/has_crashed", 0, float(w.cycle > 200))
        self.assertRegex(client.refused(self.fly()), "crashed")

    def test_a_flight_that_x_plane_started_is_not_started_again(self):
        client = self.begin()
        starts = []
        place_user = self.world.place_user
        self.world.place_user = lambda *place: (starts.append(place), place_user(*place))
        travelled, _ = client.ask({"message": "travel", "start": self.fly()["start"]})
        self.assertEqual((travelled, len(starts)), ({"message": "arrived"}, 1))
        # Held there until it is let go.
        self.assertEqual(self.world.get(OVERRIDE), 1)
        self.flown(client, already_started=True)
        self.assertEqual(len(starts), 1)
        self.followed()

    def test_scenery_that_settles_late_is_waited_for_and_one_that_never_does_is_a_reason(self):
        self.patch(scenery, HOLD_S=0.05)
        below = self.world.ground_below
        looks = []

        def settling(x, y, z):
            looks.append(1)
            # Missing, then coarse, then fine.
            hit = below(x, y, z)
            return None if len(looks) < 5 else (hit[0], hit[1] + max(0, 40 - len(looks)), hit[2])

        self.world.ground_below = settling
        client = self.begin()
        travel = {"message": "travel", "start": self.fly()["start"]}
        self.assertEqual(client.ask(travel)[0], {"message": "arrived"})
        self.assertGreater(len(looks), 40)
        self.patch(scenery, LIMIT_S=0.3)
        self.world.ground_below = lambda x, y, z: None
        self.assertRegex(client.refused(travel), "has not come within .*not there")

    def test_a_client_that_leaves_ends_the_flight(self):
        client = self.begin()
        client.send(self.fly())
        for _ in range(50):
            self.xp.frame()
        client.stream.close()
        for _ in range(2_000):
            self.xp.frame()
        self.assertEqual(self.world.get(OVERRIDE), 0)
        again = self.another()
        self.assertEqual(again.ask({"message": "hello", "client": "test"})[0]["message"], "hello")


class SettingsFile(unittest.TestCase):
    def read(self, text):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "dtd_bridge.ini"
            path.write_text(text)
            return read_settings(path)

    def test_without_a_file_the_link_is_for_this_machine(self):
        self.assertEqual(read_settings(Path("/no/such/file")), Settings("127.0.0.1", 49010, None, 15.0))

    def test_values_are_read_and_mistakes_refused(self):
        text = "[link]\nbind = 0.0.0.0 ; all\nport = 50000\ntoken = sesame\n[weather]\nsettle_s = 5\n"
        self.assertEqual(self.read(text), Settings("0.0.0.0", 50_000, "sesame", 5.0))
        self.assertTrue(self.read("[link]\ntoken = sesame\ngrab = on\n").grab)
        for wrong, words in [
            ("[link]\nbind = 0.0.0.0\n", "give a token"), ("[link]\ntokne = x\n", "tokne"), ("[link]\nport = x\n", "x"),
            ("[link]\nport = 70000\n", "65535"), ("[link]\ngrab = on\n", "give a token"), ("[link]\ntoken = x\ngrab = maybe\n", "maybe"), ("nonsense", "dtd_bridge.ini"), ("[link]\nbind = tower\n", "tower"),
        ]:  # fmt: skip
            with self.subTest(wrong), self.assertRaisesRegex(SettingsError, words):
                self.read(wrong)


class AsXPPython3Loads(unittest.TestCase):
    """The entry file itself, with ``xp`` where XPPython3 4 and 3 have it."""

    def load(self, modules):
        for name in ("xp", "XPPython3", "PI_dtd_bridge"):
            sys.modules.pop(name, None)
        sys.modules.update(modules)
        self.addCleanup(lambda: [sys.modules.pop(name, None) for name in (*modules, "PI_dtd_bridge")])
        return importlib.import_module("PI_dtd_bridge")

    def run_through(self, modules, xp):
        module = self.load(modules)
        interface = module.PythonInterface()
        with xp.inside(START):
            name, signature, _ = interface.XPluginStart()
        self.assertEqual((name.split()[0], signature), ("dtd_bridge", "dtd.bridge"))
        module.read_settings = lambda path: Settings(port=0)
        with xp.inside(ENABLE):
            self.assertEqual(interface.XPluginEnable(), 1)
        xp.frame()
        self.assertGreater(xp.world.published["dtd/bridge/capture_port"], 0)
        self.assertEqual(xp.world.published["dtd/bridge/weather_settle_s"], 15.0)
        with xp.inside(MESSAGE):
            interface.XPluginReceiveMessage(0, 104, 0)
        xp.disable(interface)
        xp.frame()
        self.assertEqual(xp.world.published["dtd/bridge/capture_port"], 0)
        with xp.inside(STOP):
            interface.XPluginStop()
        self.assertEqual((xp.misplaced, xp._accessors), ([], {}))

    def test_under_x_plane_12(self):
        xp = FakeXp(PaperWorld())
        self.run_through({"xp": xp}, xp)

    def test_under_x_plane_11(self):
        xp = FakeXp(PaperWorld())
        package = type(sys)("XPPython3")
        package.xp = xp
        self.run_through({"XPPython3": package, "xp": None}, xp)

    def test_a_failure_is_logged_and_never_raised(self):
        xp = FakeXp(PaperWorld())
        module = self.load({"xp": xp})
        interface = module.PythonInterface()
        interface.XPluginStart()

        def broken(path):
            raise SettingsError("no good")

        module.read_settings = broken
        self.assertEqual(interface.XPluginEnable(), 1)
        self.assertIn("no good", xp.lines[-1])
        xp.frame()
        self.assertEqual(xp.world.published["dtd/bridge/capture_port"], 0)
        interface.XPluginDisable()


if __name__ == "__main__":
    unittest.main()
