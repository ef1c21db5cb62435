"""The fake of ``xp`` itself: the effect of its quirks on frames and callbacks (the names are those of docs/simulator.md)."""

import unittest

import paths  # noqa: F401
from fake_xp import FakeGl, FakeXp, FakeXpError
from paper_world import PaperWorld

EVERY_FRAME = -1.0


class Frames(unittest.TestCase):
    """What happens in a frame, in its order."""

    def setUp(self):
        self.calls = []

    def fake(self, *quirks):
        self.world = PaperWorld()
        self.xp = xp = FakeXp(self.world, frozenset(quirks))
        for phase, name in ((xp.FlightLoop_Phase_AfterFlightModel, "after"), (xp.FlightLoop_Phase_BeforeFlightModel, "before")):
            xp.scheduleFlightLoop(xp.createFlightLoop(self.loop(name), phase), EVERY_FRAME)
        xp.controlCamera(xp.ControlCameraForever, self.on_camera)
        for registered in (0, 1):
            xp.registerDrawCallback(self.on_draw, xp.Phase_Window, registered, None)
        return xp

    def loop(self, name):
        def run(*_):
            self.calls.append((name, self.xp.getCycleNumber()))
            return EVERY_FRAME

        return run

    def on_camera(self, _position, is_losing_control, _refcon):
        self.calls.append(("lost" if is_losing_control else "camera", self.xp.getCycleNumber()))
        return 1

    def on_draw(self, _phase, registered, _refcon):
        self.calls.append((f"draw {registered}, {'windows' if self.xp.windows_drawn else 'scene'}", self.xp.getCycleNumber()))
        return 1

    def frame(self):
        self.calls.clear()
        self.xp.frame()
        return [name for name, _ in self.calls]

    def test_without_quirks_each_frame_is_alike_and_has_one_cycle(self):
        self.fake()
        order = ["before", "after", "camera", "draw 0, scene", "draw 1, windows"]
        self.assertEqual([self.frame() for _ in range(4)], [order] * 4)
        self.assertEqual(len({cycle for _, cycle in self.calls}), 1)

    def test_two_cycles_are_counted_for_each_loop(self):
        xp = self.fake("two_cycles_per_loop")
        self.frame()
        before = xp.getCycleNumber()
        self.frame()
        self.assertEqual(xp.getCycleNumber() - before, 2)
        cycles = dict(self.calls)
        self.assertEqual(cycles["camera"] - cycles["after"], 1)

    def test_the_camera_is_asked_before_the_loop_after_the_flight_model_in_every_other_frame(self):
        self.fake("camera_callback_order")
        after, before = ["before", "after", "camera"], ["before", "camera", "after"]
        self.assertEqual([self.frame()[:3] for _ in range(4)], [after, before, after, before])

    def test_a_draw_callback_with_1_comes_before_the_windows(self):
        self.fake("draw_before_is_one")
        self.assertEqual(self.frame()[-2:], ["draw 1, scene", "draw 0, windows"])

    def test_whoever_answers_0_loses_the_camera(self):
        xp = self.fake("camera_taken")
        xp.controlCamera(xp.ControlCameraForever, lambda *_: 0)
        self.frame()
        self.assertEqual(xp.isCameraBeingControlled(), 0)

    def test_a_flight_that_is_started_after_the_flight_model_crashes(self):
        xp = self.fake("late_start_crashes")
        place = (1.3, 103.9, 500.0, 23.0, 70.0)
        with self.assertRaisesRegex(FakeXpError, "before the flight model"):
            xp.placeUserAtLocation(*place)
        started = []
        once = xp.createFlightLoop(lambda *_: started.append(xp.placeUserAtLocation(*place)) or 0.0, xp.FlightLoop_Phase_BeforeFlightModel)
        xp.scheduleFlightLoop(once, EVERY_FRAME)
        self.frame()
        self.frame()
        self.assertEqual(len(started), 1)

    def test_other_aircraft_fly_until_they_are_acquired_and_set_to_one(self):
        xp = self.fake()
        self.world.others = True
        self.assertEqual(xp.countAircraft()[1], 2)
        with self.assertRaises(FakeXpError):
            xp.setActiveAircraftCount(1)
        xp.acquirePlanes()
        xp.setActiveAircraftCount(1)
        self.assertEqual(xp.countAircraft()[1], 1)

    def test_versions_have_five_digits(self):
        self.assertEqual(self.fake().getVersions()[0], 11_550)
        xp = self.fake()
        for internal, version in [(124_009.0, 12_400), (124_311.0, 12_430)]:
            self.world.values["sim/version/xplane_internal_version"] = [internal]
            self.assertEqual(xp.getVersions()[0], version)

    def test_pixels_are_read_with_or_without_windows(self):
        xp = self.fake("draw_before_is_one")
        seen = []
        self.world.render = lambda width, height, windows: seen.append(windows) or bytes(3 * width * height)
        gl = FakeGl(xp)
        gl._alignment = 1

        class Pixels:
            raw = b""

        def read(*_):
            gl.glReadPixels(0, 0, 4, 4, 0x1907, 0x1401, Pixels())
            return 1

        for registered in (0, 1):
            xp.registerDrawCallback(read, xp.Phase_Window, registered, None)
        self.frame()
        self.assertEqual(seen, [False, True])


if __name__ == "__main__":
    unittest.main()
