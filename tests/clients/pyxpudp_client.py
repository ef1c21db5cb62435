"""Drives the stand-in with `pyXPUDP`, unmodified. Argument: UDP port. It has no discovery.

The client requires exactly `RREF,`, writes garbage after the NUL of a path, and sends commands without a NUL.
"""

import sys
import time

from pyXPUDP import XPConnector

PAUSED = "sim/time/paused"
FREQUENCY = "sim/cockpit/radios/nav1_freq_hz"


def wait_until(what, condition, seconds=15.0):
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            sys.exit(f"{what} did not come within {seconds} s")
        time.sleep(0.02)


with XPConnector("127.0.0.1", send_port=int(sys.argv[1]), listen_freq=20) as client:
    # Requesting values subscribes to them. (Subscribing to a name that was never requested raises a ValueError in 0.0.3.1.)
    client.get_datarefs(FREQUENCY, PAUSED)
    client.subscribe_to_datarefs(FREQUENCY, PAUSED, freq=20)
    value = lambda name: client.get_dataref(name)
    wait_until("a frequency", lambda: value(FREQUENCY) == 11030.0)
    client.set_dataref(FREQUENCY, 11090.0)
    wait_until("the written frequency", lambda: value(FREQUENCY) == 11090.0)
    client.send_command("sim/operation/pause_on")
    wait_until("the pause", lambda: value(PAUSED) == 1.0)
print("ok")
