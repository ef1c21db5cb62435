"""Drives the stand-in with `xpwebapi`, unmodified: beacon, UDP and REST. Arguments: UDP port, Web API port.

It requires a name in the beacon, pads commands to 505 bytes, and expects JSON as the answer to a write.
"""

import sys
import time

import xpwebapi

PAUSED = "sim/time/paused"
FREQUENCY = "sim/cockpit/radios/nav1_freq_hz"
CLOUDS = "sim/weather/region/cloud_base_msl_m"


def wait_until(what, condition, seconds=15.0):
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            sys.exit(f"{what} did not come within {seconds} s")
        time.sleep(0.02)


def expect(what, found, wanted):
    if found != wanted:
        sys.exit(f"{what} is {found!r}, expected {wanted!r}")


udp_port, web_port = int(sys.argv[1]), int(sys.argv[2])


def discover():
    beacon = xpwebapi.beacon()
    end = time.monotonic() + 15.0
    # Other simulators may run on this computer.
    while time.monotonic() < end:
        try:
            found = beacon.get_beacon(timeout=2.0)
        except xpwebapi.XPlaneNoBeacon:
            continue
        if found is not None and found.port == udp_port:
            return found
    sys.exit("no beacon of ours within 15 s")


def over_udp():
    # Without a beacon monitor (4.0.0 cannot be given one) it waits for a beacon before every request.
    with xpwebapi.udp_api(host=found.host, port=found.port) as udp:
        values = {}
        udp.add_callback(lambda dataref, value: values.__setitem__(dataref, value))
        for path in (FREQUENCY, PAUSED):
            expect("subscription", udp.monitor_dataref(xpwebapi.Dataref(path, udp), frequency_hz=20), True)

        def read(path):
            udp.read_monitored_dataref_values()
            return values.get(path)

        wait_until("a frequency", lambda: read(FREQUENCY) == 11030.0)
        frequency = xpwebapi.Dataref(FREQUENCY, udp)
        frequency.value = 11090
        udp.write_dataref(frequency)
        wait_until("the written frequency", lambda: read(FREQUENCY) == 11090.0)
        udp.execute_command(xpwebapi.Command(udp, "sim/operation/pause_on"))
        wait_until("the pause", lambda: read(PAUSED) == 1.0)


def over_rest():
    with xpwebapi.rest_api(host="127.0.0.1", port=web_port) as rest:
        expect("reachable", rest.connected, True)
        expect("capabilities", rest.capabilities["x-plane"]["version"], "12.4.0")
        rest.set_api_version("v2")
        paused = xpwebapi.Dataref(PAUSED, rest)
        expect("pause", rest.dataref_value(paused), 1)
        expect("read-only", paused.is_writable, False)
        expect("command", rest.execute_command(xpwebapi.Command(rest, "sim/operation/pause_off")), True)
        wait_until("the end of the pause", lambda: rest.dataref_value(paused) == 0)
        frequency = xpwebapi.Dataref(FREQUENCY, rest)
        frequency.value = 11150
        expect("write", rest.write_dataref(frequency), True)
        expect("frequency", rest.dataref_value(frequency), 11150)
        cloud = xpwebapi.Dataref(f"{CLOUDS}[1]", rest)
        cloud.value = 650.5
        expect("write of an element", rest.write_dataref(cloud), True)
        expect("elements", rest.dataref_value(xpwebapi.Dataref(CLOUDS, rest)), [0.0, 650.5, 0.0])


found = discover()
expect("version in the beacon", found.xplane_version, 124009)
over_udp()
over_rest()
print("ok")
