"""Drives the stand-in with `pyxpudpserver`, unmodified. Argument: UDP port.

The client sends `0` as the fifth byte, pads paths with spaces, appends [0] to scalars, opens a socket per dataref, sends commands
without a NUL, and detects a live simulator by the name in its beacon.
"""

import sys
import time

from pyxpudpserver import pyXPUDPServer as client

PAUSED = "sim/time/paused"
FREQUENCY = "sim/cockpit/radios/nav1_freq_hz"


def wait_until(what, condition, seconds=15.0):
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            sys.exit(f"{what} did not come within {seconds} s")
        time.sleep(0.02)


udp_port, beacon_name = int(sys.argv[1]), "dtd-mock-xplane"
client.initialiseUDP(("127.0.0.1", 0), ("127.0.0.1", udp_port), beacon_name)
client.start()
try:
    # Discover.
    wait_until("the beacon", lambda: client.XPalive)

    # Subscribe and read.
    client.requestXPDref("sim/version/xplane_internal_version")
    client.requestXPDref(FREQUENCY)
    client.requestXPDref(PAUSED)
    version = lambda: client.getData("sim/version/xplane_internal_version")
    wait_until("the version", lambda: version() == 124009.0)
    wait_until("a frequency", lambda: client.getData(FREQUENCY) == 11030.0)

    # Write; the client turns it into nav1_freq_hz[0].
    client.sendXPDref(FREQUENCY, 0, 11090)
    wait_until("the written frequency", lambda: client.getData(FREQUENCY) == 11090.0)

    # Command.
    client.sendXPCmd("sim/operation/pause_on")
    wait_until("the pause", lambda: client.getData(PAUSED) == 1.0)
finally:
    client.quit()
print("ok")
