"""A network camera: motion JPEG over HTTP, from a server that a test can disconnect."""

import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

__all__ = ["StreamingCamera"]

BOUNDARY = b"image"


class StreamingCamera:
    """Serve JPEG images until unplugged; after plugging in again, on the same port.

    Args:
        images: JPEG bytes, served in turn.
        rate_hz: Images per second.
    """

    def __init__(self, images, rate_hz=30.0):
        self.images, self.period_s = images, 1 / rate_hz
        self.port = 0
        self.speaks = threading.Event()
        self.speaks.set()
        self.plug_in()

    @property
    def uri(self):
        return f"camera:http://127.0.0.1:{self.port}/stream.mjpg"

    def plug_in(self):
        camera, self.gone = self, threading.Event()

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self):
                self.send_response(200)
                self.send_header("Content-Type", f"multipart/x-mixed-replace;boundary={BOUNDARY.decode()}")
                self.end_headers()
                camera.serve(self.wfile)

            def log_message(self, *arguments):
                pass

        class Server(ThreadingHTTPServer):
            allow_reuse_address = True

            def handle_error(self, request, client_address):
                pass  # a viewer that disconnects

        self.server = Server(("127.0.0.1", self.port), Handler)
        self.port = self.server.server_address[1]
        self.thread = threading.Thread(target=self.server.serve_forever, kwargs={"poll_interval": 0.02})
        self.thread.start()

    def serve(self, file):
        number = 0
        while not self.gone.wait(self.period_s):
            while not (self.speaks.wait(0.05) or self.gone.is_set()):
                continue
            data = self.images[number % len(self.images)]
            head = b"--%s\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % (BOUNDARY, len(data))
            file.write(head + data + b"\r\n")
            number += 1

    def unplug(self):
        self.gone.set()
        self.server.shutdown()
        self.thread.join()
        self.server.server_close()

    def hang(self):
        """Stop sending, but stay connected."""
        self.speaks.clear()

    def go_on(self):
        self.speaks.set()
