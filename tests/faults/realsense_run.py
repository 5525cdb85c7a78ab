"""`haptigraph run realsense ...` on the SDK's software device, which falls silent and speaks by lines on stdin."""

import itertools
import sys
import threading

from realsense_device import SoftwareCamera

from haptigraph.cli import main
from haptigraph.recording.codec import decode
from haptigraph.sources.cameras import realsense


def feed(camera, image, silent):
    for number in itertools.count():
        threading.Event().wait(0.033)
        if not silent.is_set():
            camera.push(number, 1e6 + 33.3 * number, image)


def obey(silent):
    for line in sys.stdin:
        (silent.set if line.strip() == "silent" else silent.clear)()


if __name__ == "__main__":
    with open(sys.argv.pop(1), "rb") as file:
        image = decode(file.read())
    camera, silent = SoftwareCamera(image.shape[1::-1]), threading.Event()
    realsense.find_device = lambda serial: camera.device
    threading.Thread(target=feed, args=(camera, image, silent), daemon=True).start()
    threading.Thread(target=obey, args=(silent,), daemon=True).start()
    main()
