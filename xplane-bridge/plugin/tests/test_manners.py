"""What the plugin owes X-Plane: calls from allowed places only, faults that stay small, the names of the running version, no needless work."""

import paths  # noqa: F401

import tempfile
import unittest
from pathlib import Path
from unittest import mock

import test_bridge
from dtd_bridge import found, pixels
from dtd_bridge.flight import COLUMNS
from fake_xp import FakeXpError
from test_bridge import FREEZE, WithBridge, capture
from test_documented import documented
from xp_rules import AFTER, BEFORE, CAMERA, DISABLE, DRAW

X_PLANE_12 = 124_009


def sentences(lines, word):
    return [line for line in lines if word in line]


class Faults(WithBridge):
    """An exception in each callback in turn."""

    def fail_for(self, place, frames):
        """In every call of ``xp`` from this place."""
        self.xp.failing.add(place)
        for _ in range(frames):
            self.xp.frame()
        self.xp.failing.discard(place)

    def begin(self, client, request):
        """Frames until the request has begun."""
        client.send(request)
        while self.bridge._task is None:
            self.xp.frame()

    def four_captures(self, client, first):
        for tick in range(first, first + 4):
            answer, picture = client.ask(capture(tick))
            self.assertEqual((answer["message"], picture[2]), ("frame", self.world.colour()), answer)

    def test_four_captures_succeed_after_a_fault_in_each_callback_which_is_logged_once(self):
        for place, what in (
            (BEFORE, "the loop before the flight model"), (AFTER, "the loop after the flight model"),
            (CAMERA, "the camera's callback"), (DRAW, "a draw callback"),
        ):  # fmt: skip
            for in_a_capture in (False, True):
                with self.subTest(place, in_a_capture=in_a_capture):
                    self.setUp()
                    client = self.frozen()
                    self.four_captures(client, 0)
                    if in_a_capture:
                        self.begin(client, capture(10))
                    self.fail_for(place, 6)
                    if in_a_capture:
                        self.assertEqual(client.receive()[0]["message"], "frame")
                    self.four_captures(client, 20)
                    said = sentences(self.xp.lines, "injected")
                    # Between two captures nothing is drawn.
                    self.assertEqual(len(said), int(place != DRAW or in_a_capture), self.xp.lines)
                    self.assertTrue(all(what in line for line in said), said)

    def test_four_captures_succeed_after_a_fault_in_the_single_call_that_starts_a_flight(self):
        client = self.start()
        client.ask({"message": "hello", "client": "test"})
        start = test_bridge.Flying.fly(self)["start"]
        with mock.patch.object(self.xp, "placeUserAtLocation", side_effect=RuntimeError("injected")):
            self.assertRegex(client.refused({"message": "travel", "start": start}), "cannot begin a flight there.*injected")
        self.assertEqual(client.ask(FREEZE)[0], {"message": "frozen"})
        self.four_captures(client, 0)

    def test_what_a_client_changed_is_given_back_although_the_first_try_fails(self):
        client = self.frozen()
        client.ask(capture())
        client.stream.close()
        with mock.patch.object(self.bridge._traffic, "give_back", side_effect=RuntimeError("injected")):
            while self.bridge._client is not None:
                self.xp.frame()
        self.assertTrue(self.bridge._leaving)
        self.xp.frame()
        self.assertFalse(self.bridge._leaving)
        self.assertEqual((self.world.get(test_bridge.OVERRIDE), self.world.get("sim/time/paused")), (0, 0))
        again = self.another()
        self.assertEqual(again.ask({"message": "hello", "client": "test"})[0]["message"], "hello")
        again.ask(FREEZE)
        self.four_captures(again, 1)

    def test_the_check_pattern_is_drawn_after_a_fault(self):
        client = self.frozen()
        self.begin(client, {"message": "check_pattern", "code": 1})
        self.fail_for(DRAW, 6)
        self.assertEqual(client.receive()[0]["message"], "check_pattern_shown")
        client.ask({"message": "check_pattern", "code": None})
        self.four_captures(client, 0)

    def test_a_camera_that_cannot_be_taken_at_first_is_taken_later(self):
        client = self.frozen()
        take = self.xp.controlCamera
        with mock.patch.object(self.xp, "controlCamera", side_effect=RuntimeError("not now")):
            self.assertRegex(client.refused(capture(0)), "not now")
        self.assertEqual(self.xp.controlCamera, take)
        self.four_captures(client, 1)

    def test_a_callback_that_never_works_ends_the_capture_with_the_reason(self):
        client = self.frozen()
        self.xp.failing.add(CAMERA)
        self.assertRegex(client.refused(capture(0)), "cannot place aircraft and camera.*injected")
        self.xp.failing.clear()
        self.four_captures(client, 1)

    def test_every_line_of_the_log_is_flushed(self):
        client = self.frozen()
        self.assertEqual(client.ask({"message": "dance"})[0]["message"], "error")
        self.fail_for(AFTER, 2)
        self.assertGreater(len(self.xp.lines), 2)
        self.assertEqual(self.xp.flushed_lines, len(self.xp.lines))


class Planes(WithBridge):
    def held(self, version):
        self.world.set("sim/version/xplane_internal_version", 0, version)
        self.world.others = True
        client = self.frozen()
        self.assertEqual((self.world.others, self.xp._planes is None), (False, False))
        return client

    def test_x_plane_12_gets_its_planes_back_with_a_count_of_one(self):
        client = self.held(X_PLANE_12)
        client.ask({"message": "release"})
        self.assertEqual((self.world.others, self.xp._planes), (False, None))
        self.assertIn("with a count of 1", "\n".join(self.xp.lines))

    def test_x_plane_11_gets_back_as_many_as_there_were(self):
        client = self.held(115_501)
        client.ask({"message": "release"})
        self.assertEqual((self.world.others, self.xp._planes), (True, None))

    def test_planes_are_not_released_while_the_plugin_is_disabled(self):
        self.held(X_PLANE_12)
        self.close(self.xp, self.bridge)
        self.assertEqual((self.world.others, self.xp._planes is None), (False, False))
        self.assertIn("the planes are not released, their count stays 1", self.xp.lines[-1])
        self.assertIn("X-Plane stays paused", self.xp.lines[-1])

    def test_values_and_the_camera_are_given_back_while_the_plugin_is_disabled(self):
        before = {name: list(values) for name, values in self.world.values.items()}
        client = self.frozen()
        client.ask(capture())
        self.close(self.xp, self.bridge)
        for name, values in before.items():
            if name.startswith(("sim/operation/override/", "sim/joystick/", "sim/graphics/view/field", "sim/cockpit2/switches")):
                self.assertEqual(self.world.values[name], values, name)
        self.assertEqual((self.xp._camera, self.xp._draws, self.xp._loops), (None, [], {}))


    def test_a_step_that_fails_while_the_plugin_is_disabled_does_not_keep_the_camera(self):
        client = self.frozen()
        client.ask(capture())
        with mock.patch.object(self.bridge._stage, "put_back", side_effect=RuntimeError("injected")):
            self.close(self.xp, self.bridge)
        self.assertEqual((self.xp._camera, self.xp._draws, self.xp._loops), (None, [], {}))
        self.assertEqual(self.world.get(test_bridge.OVERRIDE), 0)
        self.assertEqual(len(sentences(self.xp.lines, "injected")), 1)


class Places(WithBridge):
    """The fake notices what X-Plane 12.4 checks."""

    def test_calls_from_a_place_that_x_plane_forbids_are_recorded_and_fail(self):
        for place, function, arguments in (
            (AFTER, "createProbe", (0,)), (AFTER, "commandOnce", ("sim/operation/pause_on",)), (BEFORE, "createFlightLoop", (None,)),
            (DISABLE, "releasePlanes", ()), (AFTER, "countAircraft", ()), (DISABLE, "commandOnce", ("sim/operation/pause_off",)),
            (CAMERA, "registerDrawCallback", (None, 50, 0, None)), (DRAW, "setDatai", (self.xp.findDataRef("sim/time/use_system_time"), 1)),
        ):  # fmt: skip
            with self.subTest(function=function, place=place), self.xp.inside(place), self.assertRaisesRegex(FakeXpError, place):
                getattr(self.xp, function)(*arguments)
            self.assertEqual(self.xp.misplaced.pop()[1], place)

    def test_x_plane_12_hangs_if_planes_are_released_while_others_are_defined(self):
        self.world.set("sim/version/xplane_internal_version", 0, X_PLANE_12)
        self.world.others = True
        self.xp.acquirePlanes()
        with self.assertRaisesRegex(FakeXpError, "hangs"):
            self.xp.releasePlanes()
        self.xp.misplaced.clear()


class Drawing(WithBridge):
    def test_draw_callbacks_are_registered_only_while_they_draw(self):
        client = self.frozen()
        client.ask(capture(0, deliver="drawn"))
        self.assertEqual(self.xp._draws, [])
        client.ask({"message": "check_pattern", "code": 7})
        self.assertEqual(len(self.xp._draws), 1)
        client.ask({"message": "check_pattern", "code": None})
        self.assertEqual(self.xp._draws, [])
        client.ask(capture(1))
        self.assertEqual(len(self.xp._draws), 1)
        for _ in range(pixels.IDLE_FRAMES + 2):
            self.xp.frame()
        self.assertEqual(self.xp._draws, [])


class Complaints(WithBridge):
    """What X-Plane's log says about us. The lines are those that others' logs have, with our names."""

    LOG = "\n".join((
        "Log.txt for X-Plane 12.4.0-r2",
        "[XPPython3]: Dataref 'sim/cockpit2/controls/flap_ratio' has been replaced. Please use the new name.",
        "[XPPython3]: Dataref 'sim/cockpit2/controls/flap_ratio' has been replaced. Please use the new name.",
        "[XPPython3]: Dataref 'sim/cockpit/switches/anti_ice_on' is deprecated and will be removed in a future version.",
        "[AviTab]: Dataref 'sim/weather/use_real_weather_bool' is deprecated and will be removed in a future version.",
        "0:17:30.684 E/PLG: The plugin XPPython3 called the SDK function XPLMCreateProbe from outside of a callback.",
        "0:17:31.000 E/PLG: The plugin AviTab called the SDK function XPLMCreateProbe from outside of a callback.",
        "0:18:00.000 I/PLG: dtd_bridge is enabled",
        "Vulkan Device       : NVIDIA GeForce RTX 3060 (5db94f1d0000)",
        "Desktop session type: wayland",
        "Loaded: X-Plane 11/Resources/plugins/AviTab/win_x64/AviTab.xpl (org.solhost.folko.avitab).",
    ))  # fmt: skip

    def test_lines_about_this_plugin_are_told_once_each_and_others_are_not(self):
        with tempfile.TemporaryDirectory() as system:
            self.world.path = system
            Path(system, "Log.txt").write_text(self.LOG)
            client = self.frozen()
            answer, _ = client.ask({"message": "installation"})
            self.assertEqual(len(answer["complaints"]), 2, answer)
            self.assertIn("flap_ratio", answer["complaints"][0])
            self.assertIn("XPLMCreateProbe", answer["complaints"][1])

    def test_graphics_and_plugins_are_those_of_the_files_and_a_change_of_the_scenery_shows(self):
        with tempfile.TemporaryDirectory() as system:
            self.world.path = system
            Path(system, "Log.txt").write_text(self.LOG)
            preferences, packs = Path(system, "Output/preferences/X-Plane.prf"), Path(system, "Custom Scenery/scenery_packs.ini")
            for path in (preferences, packs):
                path.parent.mkdir(parents=True)
            preferences.write_text("renopt_MSAA 2\n_is_tut_mode 0\n")
            client, scenery = self.frozen(), []
            for order in (("A", "B"), ("B", "A")):
                packs.write_text("SCENERY\n" + "".join(f"SCENERY_PACK Custom Scenery/{name}/\n" for name in order))
                answer, _ = client.ask({"message": "installation"})
                scenery.append(answer["settings"].pop("scenery packs"))
                self.assertEqual(answer["settings"], {
                    "Vulkan Device": "NVIDIA GeForce RTX 3060 (5db94f1d0000)", "Desktop session type": "wayland", "renopt_MSAA": "2",
                })  # fmt: skip
                self.assertEqual(answer["plugins"], ["org.solhost.folko.avitab"])
            self.assertTrue(all(found.startswith("2, ") for found in scenery) and len(set(scenery)) == 2, scenery)

    def test_a_log_that_cannot_be_read_is_a_reason(self):
        self.world.path = "/no/such/folder"
        self.assertRegex(self.frozen().refused({"message": "installation"}), "log /no/such/folder.*cannot be read")


class Names(WithBridge):
    """Only the running version's names are looked up, in a session that does everything."""

    fly, begin, flown = test_bridge.Flying.fly, test_bridge.Flying.begin, test_bridge.Flying.flown

    def session(self, version):
        self.world.set("sim/version/xplane_internal_version", 0, version)
        self.patch(found, COMES_BACK_WITHIN_S=0.0)
        client = self.begin()
        self.world.others = True
        self.assertEqual(client.ask(FREEZE)[0], {"message": "frozen"})
        for deliver in ("drawn", "picture") if version < 120_000 else ("drawn",):
            self.assertEqual(client.ask(capture(1, deliver=deliver))[0]["message"], "frame")
        client.ask({"message": "check_pattern", "code": 1})
        client.ask({"message": "still_shown"})
        client.ask({"message": "release"})
        answer, _ = client.ask(self.fly())
        self.assertEqual(answer["message"], "flown", answer)
        client.stream.close()
        for _ in range(100):
            self.xp.frame()
        return self.xp.looked_up

    def test_no_name_outside_the_table_is_touched_in_either_version(self):
        for version, column in ((115_501, "11"), (X_PLANE_12, "12")):
            with self.subTest(version):
                self.setUp()
                looked_up = self.session(version)
                self.assertGreater(len(looked_up), 60)
                self.assertEqual(sorted(looked_up - documented(column)), [])

    def test_the_flaps_of_a_flight_are_logged(self):
        rows = self.flown(self.begin())
        flaps = [row[COLUMNS.index("flap_ratio")] for row in rows]
        self.assertEqual((min(flaps[3:]), max(flaps)), (0.75, 0.75))


if __name__ == "__main__":
    unittest.main()
