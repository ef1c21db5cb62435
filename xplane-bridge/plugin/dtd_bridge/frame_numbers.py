"""The number of a drawn frame, counted from X-Plane's callbacks. Pure.

X-Plane runs the flight loop once a frame, asks for the camera once or more in each frame, before or after that loop, and draws 0 to n times
a frame. Only a frame in which all of this happened as expected has a number. Any doubt breaks the sequence: the next frame says that it
does not know the ones before it.
"""

from __future__ import annotations


class FrameNumbers:
    """One number for each frame that was drawn with our camera."""

    def __init__(self) -> None:
        self.number = 0
        # How many frames directly before this one have the numbers before it; -1: not even this one is known.
        self.steady = -1
        # Since the last drawing.
        self._asked = False
        self._loops = 0

    def begin(self, at_least: int) -> None:
        """A new sequence, with numbers larger than all before."""
        self.number = max(self.number, at_least)
        self.steady = -1
        self._asked, self._loops = False, 0

    def loop(self) -> None:
        """The flight loop ran."""
        self._loops += 1

    def camera(self) -> bool:
        """X-Plane asks for the camera. Whether a new frame begins, which may show something else: only after a drawing, since a second
        question is either one of the same frame or one after a frame that was not drawn."""
        if self._asked:
            return False
        self._asked = True
        self.number += 1
        self.steady += 1
        return True

    def drawn(self) -> bool:
        """A frame is being drawn. Whether it has the current number."""
        if self._loops > 1:
            # A frame before this one was not drawn.
            self.number += 1
            self.steady = -1
        elif self._loops == 1 and not self._asked:
            # A frame for which X-Plane did not ask for the camera.
            self.steady = -1
        self._asked, self._loops = False, 0
        return self.steady >= 0

    def doubt(self) -> None:
        """This frame may show something else."""
        self.steady = -1
