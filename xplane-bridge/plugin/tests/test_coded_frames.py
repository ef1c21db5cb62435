"""Captures of one drawn frame each: numbers, codes, and what breaks them."""

import paths  # noqa: F401

import binascii
import unittest

from dtd_bridge.frame_code import COLUMN_BARS, MARGIN_PX, code_of, rectangles
from dtd_bridge.frame_numbers import FrameNumbers
from test_bridge import FREEZE, WithBridge, capture, pose

MARGINS = (16, 16)
SIZE = (96, 64)
WINDOW = (128, 96)


def painted(code, width=WINDOW[0], height=WINDOW[1]):
    """The window as grey levels; -1 where nothing is drawn."""
    rows = [[-1] * width for _ in range(height)]
    for left, top, right, bottom, (level, _, _) in rectangles(code, width, height, *MARGINS):
        for row in rows[top:bottom]:
            row[left:right] = [level] * (right - left)
    return rows


def read_strip(row):
    """The code of a strip's row, if its checksum is right."""
    width = len(row)
    bits = 0
    for cell in range(48):
        bits = bits << 1 | (row[width * (2 * cell + 1) // 96] == 255)
    code = bits >> 16
    return code if bits & 0xFFFF == binascii.crc_hqx(code.to_bytes(4, "big"), 0xFFFF) else None


class Codes(unittest.TestCase):
    def test_both_strips_carry_the_code_and_the_column_the_numbers_lowest_bits(self):
        for number in (0, 1, 4_711, 2**24 - 1, 2**24 + 5):
            code = code_of(number, 9, True, 17)
            rows = painted(code)
            for at in (MARGIN_PX // 2, WINDOW[1] - MARGIN_PX // 2):
                self.assertEqual(read_strip(rows[at]), code)
            self.assertEqual((code >> 8, code >> 5 & 7, code >> 4 & 1, code & 15), (number % 2**24, 7, 1, 1))
            for row in rows[MARGIN_PX:-MARGIN_PX]:
                bars = [row[MARGIN_PX * (2 * bar + 1) // (2 * COLUMN_BARS)] == 255 for bar in range(COLUMN_BARS)]
                self.assertEqual(bars, [True, False, *(number >> bit & 1 == 1 for bit in (4, 3, 2, 1, 0)), False])

    def test_the_picture_stays_free(self):
        for row in painted(code_of(123_456, 7, False, 0))[MARGIN_PX:-MARGIN_PX]:
            self.assertEqual(set(row[MARGIN_PX:]), {-1})


class Numbers(unittest.TestCase):
    def frame(self, numbers, events="LCD"):
        """The events of a frame: flight loop, camera, drawing. Whether a tick may move on, and whether the drawn frame has a number."""
        moves = drawn = None
        for event in events:
            if event == "L":
                numbers.loop()
            elif event == "C":
                moves = numbers.camera()
            else:
                drawn = numbers.drawn()
        return moves, drawn

    def begun(self):
        numbers = FrameNumbers()
        numbers.begin(100)
        return numbers

    def test_each_frame_has_the_next_number_in_whatever_order_the_callbacks_come(self):
        numbers = self.begun()
        for at, order in enumerate(["LCD", "CLD", "LCDD", "CLDDD"] * 3):
            self.assertEqual(self.frame(numbers, order), (True, True), order)
            self.assertEqual((numbers.number, numbers.steady), (101 + at, at))

    def test_a_frame_without_a_camera_callback_has_no_number_and_the_next_does_not_know_the_last(self):
        numbers = self.begun()
        self.frame(numbers)
        self.assertEqual(self.frame(numbers, "LD"), (None, False))
        self.assertEqual(self.frame(numbers), (True, True))
        self.assertEqual(numbers.steady, 0)

    def test_a_frame_that_was_not_drawn_lets_no_tick_move_on_unseen(self):
        numbers = self.begun()
        self.frame(numbers)
        self.assertEqual(self.frame(numbers, "LC"), (True, None))
        self.assertEqual(self.frame(numbers), (False, False))
        self.assertEqual(self.frame(numbers), (True, True))
        self.assertEqual(numbers.steady, 0)

    def test_a_camera_that_is_asked_twice_in_a_frame_does_not_move_on_twice(self):
        numbers = self.begun()
        numbers.loop()
        self.assertTrue(numbers.camera())
        self.assertFalse(numbers.camera())
        self.assertTrue(numbers.drawn())
        self.assertEqual((numbers.number, numbers.steady), (101, 0))

    def test_frames_have_numbers_although_the_camera_is_asked_twice_on_either_side_of_the_flight_loop(self):
        numbers = self.begun()
        for at, order in enumerate(["CLCD", "CCLD", "LCCD", "CLCDD"] * 3):
            self.assertEqual(self.frame(numbers, order)[1], True, order)
            self.assertEqual((numbers.number, numbers.steady), (101 + at, at))

    def test_a_frame_that_was_not_drawn_is_noticed_although_the_camera_is_asked_twice(self):
        numbers = self.begun()
        self.frame(numbers, "CLCD")
        self.frame(numbers, "CLC")
        self.assertEqual(self.frame(numbers, "CLCD"), (False, False))
        self.assertEqual(self.frame(numbers, "CLCD")[1], True)
        self.assertEqual(numbers.steady, 0)


class CodedCaptures(WithBridge):
    def shown(self):
        """A frozen simulator whose window has margins, and every code that it has drawn."""
        self.world.set("sim/graphics/view/window_width", 0, WINDOW[0])
        self.world.set("sim/graphics/view/window_height", 0, WINDOW[1])
        client = self.start()
        client.ask({"message": "hello", "client": "test"})
        self.assertEqual(client.ask({**FREEZE, "margins_px": list(MARGINS)})[0], {"message": "frozen"})
        self.codes, frame = [], self.xp.frame

        def watched():
            frame()
            rows = [[-1] * WINDOW[0] for _ in range(WINDOW[1])]
            for left, bottom, right, top, level, *_ in self.xp.rectangles:
                for row in rows[WINDOW[1] - round(top) : WINDOW[1] - round(bottom)]:
                    row[round(left) : round(right)] = [level] * (round(right) - round(left))
            self.codes.append(read_strip(rows[MARGIN_PX // 2]))

        self.bridge.step_in_frame = watched
        return client

    @staticmethod
    def coded(tick, deliver="coded"):
        return capture(tick, deliver, width_px=SIZE[0], height_px=SIZE[1])

    def numbers(self):
        return [code >> 8 for code in self.codes if code is not None]

    def test_every_drawn_frame_shows_another_tick_and_carries_its_number(self):
        client = self.shown()
        for tick in range(20):
            client.send(self.coded(tick))
        answers = [client.receive()[0] for _ in range(20)]
        frames = [answer["sim_frame"] for answer in answers]
        self.assertEqual([answer["tick"] for answer in answers], list(range(20)))
        self.assertEqual(frames, list(range(frames[0], frames[0] + 20)))
        self.assertLessEqual(set(frames), set(self.numbers()))
        for tick, answer in enumerate(answers):
            self.near(answer["pose"], pose(latitude=1.3 + tick / 1000))
            self.assertAlmostEqual(answer["camera"]["hfov_deg"], 10.0, delta=0.0002)

    def test_every_drawn_frame_shows_another_tick_although_the_camera_is_asked_before_and_after_the_flight_loop(self):
        client = self.shown()
        run_loops, before_it = self.xp._run_loops, self.xp.FlightLoop_Phase_AfterFlightModel

        def asked_before(phase):
            if phase == before_it:
                self.xp._run_camera()
            run_loops(phase)

        self.xp._run_loops = asked_before
        for tick in range(20):
            client.send(self.coded(tick))
        frames = [client.receive()[0]["sim_frame"] for _ in range(20)]
        self.assertEqual(frames, list(range(frames[0], frames[0] + 20)))
        self.assertLessEqual(set(frames), set(self.numbers()))

    def test_the_last_tick_stays_under_new_numbers_and_a_probe_says_so(self):
        client = self.shown()
        first = client.ask(self.coded(0))[0]["sim_frame"]
        for _ in range(9):
            self.bridge.step_in_frame()
        probe = client.ask(self.coded(1, "probe"))[0]["sim_frame"]
        self.assertGreaterEqual(probe, first + 9)
        marks = {code >> 8: code >> 4 & 1 for code in self.codes if code is not None}
        self.assertEqual((marks[first], marks[probe - 1], marks[probe]), (0, 0, 1))

    def test_a_camera_that_is_taken_breaks_the_sequence_of_numbers_and_no_tick_is_lost(self):
        client = self.shown()
        for tick in range(30):
            client.send(self.coded(tick))
        thefts = [40, 47]
        step = self.bridge.step_in_frame

        def disturbed():
            if len(self.codes) in thefts:
                self.xp.steal_camera()
            step()

        self.bridge.step_in_frame = disturbed
        for _ in range(60):
            disturbed()
        answers = [client.receive()[0] for _ in range(30)]
        self.assertEqual([answer["tick"] for answer in answers], list(range(30)))
        steady = [code >> 5 & 7 for code in self.codes[30:55]]
        self.assertEqual(steady.count(0), len(thefts))
        for answer in answers:
            self.assertIn(answer["sim_frame"], self.numbers())

    def test_other_requests_wait_for_the_answers_before_them_and_end_the_codes(self):
        client = self.shown()
        client.send(self.coded(0))
        client.send({"message": "release"})
        self.assertEqual([client.receive()[0]["message"] for _ in range(2)], ["frame", "released"])
        before = len(self.codes)
        for _ in range(5):
            self.bridge.step_in_frame()
        self.assertEqual(self.codes[before + 1 :], [None] * (len(self.codes) - before - 1))

    def test_a_window_without_margins_is_refused_in_the_order_of_the_requests(self):
        client = self.frozen()
        client.send(self.coded(0))
        client.send({"message": "release"})
        self.assertIn("16 or more", client.receive()[0]["text"])
        self.assertEqual(client.receive()[0]["message"], "released")


if __name__ == "__main__":
    unittest.main()
