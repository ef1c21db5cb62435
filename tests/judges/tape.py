"""A tape as read by MCAP's own reader: every checksum is checked, and the contents are counted as JSON.

Usage: python tape.py TAPE.mcap
"""

import json
import struct
import sys
from collections import Counter

from mcap.reader import make_reader

counts, pictures, last_time = Counter(), 0, 0
with open(sys.argv[1], "rb") as file:
    reader = make_reader(file, validate_crcs=True)
    header = reader.get_header()
    summary = reader.get_summary()
    metadata = {m.name: m.metadata for m in reader.iter_metadata()}
    for _, channel, message in reader.iter_messages(log_time_order=False):
        kind = channel.topic.split("/")[1] + "/" + "/".join(channel.topic.split("/")[3:])
        counts[kind] += 1
        assert message.log_time >= last_time, "the tape goes back in time"
        last_time = message.log_time
        data = message.data
        if kind.startswith("udp/"):
            assert channel.message_encoding == "xplane-udp"
            assert data[:4].isalpha() and data[:4].isupper(), data[:8]
            if kind == "udp/to_simulator" and data[:4] == b"RREF":
                assert len(data) == 413
        else:
            assert channel.message_encoding == "dtd-link"
            head, payload = struct.unpack("<II", data[:8])
            assert len(data) == 8 + head + payload
            answer = json.loads(data[8 : 8 + head])
            pictures += answer["message"] == "frame" and payload == answer["width_px"] * answer["height_px"] * 3

assert summary.statistics.message_count == sum(counts.values())
assert header.profile == "dtd-tape"
print(json.dumps({"messages": counts, "pictures": pictures, "metadata": metadata["dtd-tape"]}))
