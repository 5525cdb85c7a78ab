"""Read an MCAP file with Rerun's own library, and save what it decodes; runs in an environment of Rerun's.

python read_rerun.py RUN.mcap OUT.json: log time and fields of every message on /step, log time, media type and
SHA-256 of every image.
"""

import hashlib
import json
import sys

from rerun.chunk import McapReader

path, output = sys.argv[1:]
steps, images = [], []
for chunk in McapReader(path).stream():
    columns = dict(zip(chunk.to_record_batch().schema.names, chunk.to_record_batch().columns, strict=True))
    times = columns.get("message_log_time")
    for index in range(0 if times is None else len(times)):
        time_ns = times[index].value
        if "haptigraph.Step:message" in columns:
            steps.append((time_ns, columns["haptigraph.Step:message"][index].as_py()[0]))
        if "EncodedImage:blob" in columns:
            blob = bytes(columns["EncodedImage:blob"][index].as_py()[0])
            media_type = columns["EncodedImage:media_type"][index].as_py()[0]
            images.append((time_ns, media_type, hashlib.sha256(blob).hexdigest()))
with open(output, "w") as file:
    json.dump({"steps": sorted(steps, key=lambda step: step[0]), "images": sorted(images)}, file)
