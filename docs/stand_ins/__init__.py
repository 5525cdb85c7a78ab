"""What a reader has and this machine has not: a clip, a recording, a camera, a board at a serial port.

A page names them in `<!-- given NAME -->`. Each is as real as this machine allows: the clip is a video
file, the board answers Firmata at a pseudo-terminal.
"""

from collections.abc import Callable
from pathlib import Path

from stand_ins import data, hardware, images
from stand_ins.stand_in import StandIn

STAND_INS: dict[str, Callable[[Path], StandIn]] = {
    function.__name__: function
    for function in (
        images.clip,
        images.eye,
        images.camera,
        images.sheet,
        images.rig,
        images.scan,
        images.bscans,
        images.network,
        images.volumes,
        images.rosbag,
        hardware.arduino,
        hardware.driver_chip,
        hardware.driver_chips,
        hardware.inverse3,
        data.recording,
        data.small_recording,
        data.repository,
        data.contact,
        data.bent,
        data.short_recording,
        data.recordings,
        data.study,
        data.answers,
        data.fast,
    )
}
