"""Helpers of the tests of the registration page: images to open, and requests to its routes."""

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


def write_noise(folder):
    noise = np.random.default_rng(0).integers(90, 160, (270, 480, 3), np.uint8)
    cv2.imwrite(str(folder / "wall.png"), noise)
    return folder / "wall.png"


def send(live, path, content=None, **headers):
    """Send a request to a route of the registration page."""
    return send_to(live, f"/registration/{path}", content, **headers)


def send_to(live, path, content=None, **headers):
    """Send a request as the page's script does; return status and content of the response."""
    address = live.url.removeprefix("http://").partition("/")[0]
    connection = http.client.HTTPConnection(address, timeout=60)
    body = content if isinstance(content, bytes | None) else json.dumps(content)
    connection.request(
        "GET" if content is None else "POST",
        path,
        body=body,
        headers={"Origin": f"http://{address}", **headers},
    )
    response = connection.getresponse()
    data = response.read()
    connection.close()
    if response.headers["Content-Type"] != "application/json":
        return response.status, data
    return response.status, json.loads(data)


def write_clip(folder, quick, count=10):
    """Write a folder of images in which the needle enters and pivots."""
    phantom = Phantom(load_scenario(quick))
    images = []
    while (moment := phantom.advance()) is not None:
        images.append(moment.image)
    for number, image in enumerate(images[:: len(images) // count]):
        cv2.imwrite(str(folder / f"{number:03}.png"), image)
    return folder
