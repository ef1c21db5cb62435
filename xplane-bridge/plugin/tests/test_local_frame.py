"""Poses in X-Plane's local coordinates: correct directions, and a round trip to within rounding wherever the origin is."""

import paths  # noqa: F401

import math
import unittest

from dtd_bridge.local_frame import LocalFrame, LocalPose
from dtd_bridge.messages import Pose
from paper_world import PaperWorld

POSE = Pose(1.36, 103.98, 300.0, 203.25, 1.6, -0.5)


def frame_of(world: PaperWorld) -> LocalFrame:
    return LocalFrame(world.world_to_local, world.local_to_world)


class InLocalCoordinates(unittest.TestCase):
    def test_at_the_origin_east_is_x_up_is_y_south_is_z_and_angles_are_the_same(self):
        world = PaperWorld()
        world.origin = (1.36, 103.98)
        local = frame_of(world).place(POSE)
        self.assertAlmostEqual(local.x, 0, places=6)
        self.assertAlmostEqual(local.y, 300, places=6)
        self.assertAlmostEqual(local.z, 0, places=6)
        for found, wanted in zip((local.psi, local.theta, local.phi), (203.25, 1.6, -0.5)):
            self.assertAlmostEqual(found, wanted, places=7)
        self.assertGreater(frame_of(world).place(Pose(1.36, 104.0, 300, 0, 0, 0)).x, 2_000)
        self.assertLess(frame_of(world).place(Pose(1.40, 103.98, 300, 0, 0, 0)).z, -4_000)

    def test_far_from_the_origin_level_is_not_flat_and_north_is_not_minus_z(self):
        world = PaperWorld()
        world.origin = (50.0, 8.0)
        local = frame_of(world).place(Pose(50.0, 8.5, 0.0, 0.0, 0.0, 0.0))
        # Meridians meet at the pole: east of the origin, north leans to the west.
        self.assertAlmostEqual(local.psi, 360 - 0.5 * math.sin(math.radians(50)), delta=2e-3)
        # And the earth falls away to the east: the right wing hangs down in local coordinates.
        self.assertAlmostEqual(local.phi, 0.5 * math.cos(math.radians(50)), delta=2e-3)
        self.assertLess(local.y, -90)

    def test_a_pose_comes_back_wherever_the_origin_lies(self):
        for origin in [(1.0, 104.0), (1.36, 103.98), (0.5, 103.4), (1.9, 104.6)]:
            world = PaperWorld()
            world.origin = origin
            back = frame_of(world).read(frame_of(world).place(POSE))
            self.assertAlmostEqual(back.latitude_deg, POSE.latitude_deg, places=10)
            self.assertAlmostEqual(back.longitude_deg, POSE.longitude_deg, places=10)
            for name in ("altitude_msl_m", "heading_true_deg", "pitch_deg", "roll_deg"):
                self.assertAlmostEqual(getattr(back, name), getattr(POSE, name), places=6, msg=name)

    def test_velocities_turn_with_the_axes_and_come_back(self):
        world = PaperWorld()
        frame = frame_of(world)
        local = frame.velocity_local(POSE, (70.0, 30.0, 4.0))
        self.assertAlmostEqual(math.hypot(*local), math.hypot(70, 30, 4), places=6)
        self.assertLess(local[2], -65)
        self.assertGreater(local[0], 25)
        back = frame.velocity_ned(frame.place(POSE), local)
        for found, wanted in zip(back, (70.0, 30.0, 4.0)):
            self.assertAlmostEqual(found, wanted, places=5)

    def test_the_quaternion_is_the_same_rotation(self):
        q = LocalPose(0, 0, 0, 90.0, 0.0, 0.0).quaternion()
        for found, wanted in zip(q, (math.sqrt(0.5), 0, 0, math.sqrt(0.5))):
            self.assertAlmostEqual(found, wanted)
        w, x, y, z = LocalPose(0, 0, 0, 203.25, 12.0, -31.0).quaternion()
        self.assertAlmostEqual(w * w + x * x + y * y + z * z, 1.0)
        # Back by the textbook's formulas.
        self.assertAlmostEqual(math.degrees(math.asin(2 * (w * y - z * x))), 12.0)
        self.assertAlmostEqual(math.degrees(math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))), -31.0)
        self.assertAlmostEqual(math.degrees(math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))) % 360, 203.25)


if __name__ == "__main__":
    unittest.main()
