"""`haptigraph run realsense ...` on the software device of the SDK, which stops and resumes by lines on stdin."""

import itertools
import sys
import threading

from realsense_device import SoftwareCamera

from haptigraph.cli import main
from haptigraph.recording.codec import decode
from haptigraph.sources.cameras import realsense


def feed(camera, image, is_stopped):
    for number in itertools.count():
        threading.Event().wait(0.033)
        if not is_stopped.is_set():
            camera.push(number, 1e6 + 33.3 * number, image)


def read_requests(is_stopped):
    for line in sys.stdin:
        (is_stopped.set if line.strip() == "stop" else is_stopped.clear)()


if __name__ == "__main__":
    with open(sys.argv.pop(1), "rb") as file:
        image = decode(file.read())
    camera, is_stopped = SoftwareCamera(image.shape[1::-1]), threading.Event()
    realsense.find_device = lambda serial: camera.device
    threading.Thread(target=feed, args=(camera, image, is_stopped), daemon=True).start()
    threading.Thread(target=read_requests, args=(is_stopped,), daemon=True).start()
    main()
