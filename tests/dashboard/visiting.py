"""Visit a running `haptigraph live` as a browser does, or otherwise."""

import http.client
import json
from contextlib import contextmanager

from websockets.sync.client import connect


def address(live):
    return live.url.removeprefix("http://").partition("/")[0]


def get(live, path="/", method="GET", **headers):
    connection = http.client.HTTPConnection(address(live), timeout=10)
    connection.request(
        method, path, headers={name.replace("_", "-"): value for name, value in headers.items()}
    )
    response = connection.getresponse()
    text = response.read().decode()
    connection.close()
    return response.status, text, response.headers


@contextmanager
def watching(live, **options):
    """Open the socket as the page does."""
    origin, path = options.pop("origin", f"http://{address(live)}"), options.pop("path", "/live")
    with connect(f"ws://{address(live)}{path}", origin=origin, open_timeout=10, **options) as line:
        yield line


def next_text(line, kind):
    """Return the next text message of a type; acknowledge images in between, as a page does."""
    while True:
        message = line.recv(timeout=10)
        if isinstance(message, bytes):
            acknowledge(line, message)
        elif (content := json.loads(message))["type"] == kind:
            return content


def next_image(line):
    while isinstance(message := line.recv(timeout=10), str):
        continue
    return acknowledge(line, message)


def acknowledge(line, message):
    length = int.from_bytes(message[:4], "big")
    header = json.loads(message[4 : 4 + length])
    line.send(json.dumps({"type": "ack", "number": header["number"]}))
    return header, message[4 + length :]
