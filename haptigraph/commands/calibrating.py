"""The command that measures how strong a device feels: devices calibrate."""

import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from haptigraph.commands.help import examples
from haptigraph.commands.terminal import terminable
from haptigraph.errors import BadInput, DeviceError, NotSilent

if TYPE_CHECKING:
    from haptigraph.clock import Clock
    from haptigraph.haptics.guard import Guard
    from haptigraph.haptics.profiles.calibration import Calibrated
    from haptigraph.haptics.profiles.measuring import Trial
    from haptigraph.haptics.profiles.profile import DeviceProfile
    from haptigraph.stages import Device

__all__ = ["devices_calibrate"]

SAFETY = "Research software: only healthy adults who agreed, on their own hand. Ctrl-C stops at any time."
BEFORE_NS, BETWEEN_NS, AFTER_NS = 600_000_000, 500_000_000, 100_000_000
REPEAT = "r"
FREQUENCY_HZ = 160.0


@click.command(
    "calibrate",
    epilog=examples(
        "haptigraph devices calibrate gamepad:0 -o pad.toml --by P01 --description 'pad, index finger'",
        "haptigraph devices calibrate audio -o coil.toml --by P01 --description glove --reference gamepad:0",
        "haptigraph check --profile pad.toml",
        "haptigraph run SOURCE --device gamepad:0 --profile pad.toml",
    ),
)
@click.argument("device")
@click.option("-o", "--output", metavar="FILE", required=True, help="Profile to write (TOML).")
@click.option("--by", metavar="NAME", required=True, help="Who feels it; a pseudonym.")
@click.option("--description", metavar="TEXT", required=True, help="Actuator, and where it touches the skin.")
@click.option("--reference", metavar="DEVICE", help="Match the strength of this device, in the other hand.")
@click.option(
    "--frequency-hz",
    type=click.FloatRange(20, 500),
    default=FREQUENCY_HZ,
    show_default=True,
    help="Of the vibrations, if the device can choose it.",
)
@click.option(
    "--max-drive",
    type=click.FloatRange(0.05, 1),
    default=1.0,
    show_default=True,
    help="Largest drive that is played and used.",
)
@click.option("--force", is_flag=True, help="Overwrite an existing file.")
def devices_calibrate(
    device: str,
    output: str,
    by: str,
    description: str,
    reference: str | None,
    frequency_hz: float,
    max_drive: float,
    force: bool,
) -> None:
    """Measure how strong DEVICE feels to you, and write its profile; 10 to 20 minutes, with keys.

    With --reference, amplitudes feel as strong as on that device. Without it you rate the device's vibrations
    relative to its strongest, so two devices agree only if their strongest feel alike. It also measures the
    weakest drive and the shortest burst that you feel, and the round trip of a device that confirms commands.
    Nothing vibrates before you agree. The file is written at the end, or not at all.
    """
    import datetime

    from haptigraph.files import write_files
    from haptigraph.haptics.observed_device import is_felt
    from haptigraph.haptics.profiles.calibration import Calibrated
    from haptigraph.haptics.profiles.writing import profile_text

    path = Path(output)
    _check_output(path, force=force)
    for each in (device, reference or device):
        if not is_felt(each):
            raise BadInput(f"{each} is not felt, so nobody can say how strong it is; choose an actuator")
    if device == reference:
        raise BadInput(f"--reference {reference}: compare {device} with another device")
    seed = time.time_ns() % 2**32
    today = datetime.datetime.now(datetime.UTC).date()
    given = Calibrated(device, description, by, today, seed, frequency_hz, reference or "", max_drive)
    with terminable(), _session(given) as session:
        profile = session.measured()
    text = profile_text(profile)
    _check_output(path, force=force)
    write_files([path], [text.encode()])
    _report(profile, path)


class _Session:
    """Devices behind their guards, and a person at the keys.

    Args:
        given: What is calibrated.
        devices: By "device" and "reference".
        guards: The same, behind their guards.
        clock: Paces the vibrations.
    """

    def __init__(
        self,
        given: "Calibrated",
        devices: "Mapping[str, Device]",
        guards: "Mapping[str, Guard]",
        clock: "Clock",
    ) -> None:
        self._given, self._devices, self._guards, self._clock = given, devices, guards, clock

    def measured(self) -> "DeviceProfile":
        """Measure everything, after the person has agreed."""
        from msgspec.structs import replace

        from haptigraph.haptics.pattern import min_interval_ms
        from haptigraph.haptics.profiles.calibration import calibrate
        from haptigraph.haptics.profiles.latency import measure_latency

        device, given = self._devices["device"], self._given
        if device.capabilities.frequency_range_hz is None:
            given = replace(given, frequency_hz=None)
        given = replace(given, interval_ms=min_interval_ms(device.capabilities))
        if device.capabilities.answers:
            given = replace(given, latency=measure_latency(device, time.perf_counter_ns))
        click.echo(SAFETY)
        click.echo(f"The largest drive is {given.max_drive:g}. Nothing has vibrated yet.")
        click.confirm("Do you agree to feel vibrations now?", abort=True)
        return calibrate(self._ask, given, _begin)

    def _ask(self, trial: "Trial") -> str:
        """Play a trial, and return the answer."""
        from haptigraph.haptics.profiles.measuring import NUMBER

        while True:
            self._play(trial)
            prompt = f"{trial.number:3} of {trial.of}  {trial.question} [r: again] "
            answer = _number(prompt) if trial.choices == NUMBER else _key(prompt, trial.choices)
            if answer != REPEAT:
                return answer

    def _play(self, trial: "Trial") -> None:
        from haptigraph.analysis.actuators import play_pattern
        from haptigraph.messages import OFF, Pattern

        pause_ns = BEFORE_NS
        for burst in trial.bursts:
            guard = self._guards[burst.output]
            drive = burst.drive * (self._given.max_drive if burst.output == "device" else 1.0)
            hz = self._given.frequency_hz or 0.0
            pattern = Pattern(trial.task, "bursts", drive, hz, on_ms=burst.on_ms, count=1)
            play_pattern(guard, OFF, pause_ns, self._clock)
            play_pattern(guard, pattern, round(burst.on_ms * 1e6), self._clock)
            play_pattern(guard, OFF, AFTER_NS, self._clock)
            pause_ns = BETWEEN_NS
            if faults := guard.take_faults():
                raise DeviceError(f"{faults[0].message}; the calibration is stopped, nothing was written")


@contextmanager
def _session(given: "Calibrated") -> Iterator[_Session]:
    """Open the devices; they are silent and closed on every exit."""
    from msgspec.structs import replace

    from haptigraph.assemble import open_device
    from haptigraph.clock import MonotonicClock
    from haptigraph.config import HapticsConfig
    from haptigraph.haptics.guard import Guard

    class Unfitted:
        """A device whose bursts the guard does not lengthen: their shortest length is measured."""

        def __init__(self, device: "Device") -> None:
            self.capabilities = replace(device.capabilities, shortest_on_ms=0.0)
            self.set, self.close = device.set, device.close

    limits = {"device": given.max_drive, "reference": 1.0}
    devices: dict[str, Device] = {}
    guards: dict[str, Guard] = {}
    with ExitStack() as stack:
        for name, uri in (("device", given.uri), ("reference", given.reference)):
            if not uri:
                continue
            devices[name] = open_device(uri)
            guards[name] = Guard(Unfitted(devices[name]), HapticsConfig(max_amplitude=limits[name]))
            stack.callback(_close, guards[name], uri)
            if devices[name].capabilities.amplitude_levels < 2:
                raise BadInput(f"{uri} only knows on and off, so there is no strength to measure")
        yield _Session(given, devices, guards, MonotonicClock())


def _close(guard: "Guard", uri: str) -> None:
    guard.close()
    if not guard.is_silent:
        raise NotSilent(uri)


def _begin(text: str) -> None:
    click.echo(f"\n{text}")
    click.prompt("Press Enter to begin", default="", show_default=False)


def _key(prompt: str, choices: tuple[str, ...]) -> str:
    """Return the key that was pressed, one of the choices or `REPEAT`."""
    click.echo(prompt, nl=False)
    while True:
        try:
            key = click.getchar().lower()
        except OSError:
            key = ""
        if not key:
            raise BadInput("calibration needs a terminal with keys; standard input is none")
        if key in (*choices, REPEAT):
            click.echo(key)
            return key


def _number(prompt: str) -> str:
    """Return the number that was entered, or `REPEAT`."""
    while True:
        answer = str(click.prompt(prompt.rstrip(), prompt_suffix=" ")).strip().lower()
        if answer == REPEAT or (answer.isdecimal() and int(answer) <= 200):
            return answer
        click.echo("enter a whole number from 0 to 200, or r")


def _check_output(path: Path, *, force: bool) -> None:
    if path.suffix != ".toml":
        raise BadInput("the name of a profile's file ends in .toml", path)
    if not path.parent.is_dir():
        raise BadInput("its folder does not exist; create it first", path)
    if path.exists() and not force:
        raise BadInput("exists already; --force overwrites it", path)


def _report(profile: "DeviceProfile", path: Path) -> None:
    """Print what was measured, and what it does not say."""
    threshold, intensity = profile.threshold, profile.intensity
    click.echo(f"\nthreshold       drive {threshold.drive:.3f} ({threshold.low:.3f} to {threshold.high:.3f})")
    for point in intensity.point:
        click.echo(f"drive {point.drive:.3f}     intensity {point.intensity:.2f} ± {point.sd:.2f}")
    if profile.onset is None:
        click.echo("shortest burst  not found: bursts of 500 ms are felt too rarely")
    else:
        onset = profile.onset
        click.echo(
            f"shortest burst  {onset.shortest_on_ms:.0f} ms ({onset.low_ms:.0f} to {onset.high_ms:.0f})"
        )
    if profile.latency is not None:
        click.echo(
            f"round trip      {profile.latency.p50_ms:.2f} ms (p50), {profile.latency.p95_ms:.2f} ms (p95)"
        )
    click.echo("This is one person on one day; other people and other ways to hold it differ.")
    click.echo(f"{path} was written; next: haptigraph check --profile {path}")
