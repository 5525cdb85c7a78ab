"""What tests of the registration page share: pictures to open, and one `haptigraph live` that serves it."""

import http.client
import json

import cv2
import numpy as np

from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenario import load_scenario


def eye_image(quick):
    moment = Phantom(load_scenario(quick)).advance()
    assert moment is not None
    return moment.image


def write_eye(folder, quick):
    cv2.imwrite(str(folder / "eye.png"), eye_image(quick))
    return folder / "eye.png"


def write_grain(folder):
    grain = np.random.default_rng(0).integers(90, 160, (270, 480, 3), np.uint8)
    cv2.imwrite(str(folder / "wall.png"), grain)
    return folder / "wall.png"


def ask(live, path, content=None, **headers):
    """Ask a route of the registration page."""
    return ask_at(live, f"/registration/{path}", content, **headers)


def ask_at(live, path, content=None, **headers):
    """Ask a route as the page's own script does; the status, and what was answered."""
    address = live.url.removeprefix("http://").partition("/")[0]
    connection = http.client.HTTPConnection(address, timeout=60)
    body = content if isinstance(content, bytes | None) else json.dumps(content)
    connection.request(
        "GET" if content is None else "POST",
        path,
        body=body,
        headers={"Origin": f"http://{address}", **headers},
    )
    answer = connection.getresponse()
    data = answer.read()
    connection.close()
    if answer.headers["Content-Type"] != "application/json":
        return answer.status, data
    return answer.status, json.loads(data)


def write_clip(folder, quick, most=16):
    """A folder of images in which the needle goes in and turns."""
    phantom = Phantom(load_scenario(quick))
    images = []
    while (moment := phantom.advance()) is not None:
        images.append(moment.image)
    for number, image in enumerate(images[:: len(images) // most]):
        cv2.imwrite(str(folder / f"{number:03}.png"), image)
    return folder
