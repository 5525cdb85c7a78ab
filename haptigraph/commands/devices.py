"""Commands for actuators: devices, devices test, devices auto-calibrate."""

import sys
from contextlib import AbstractContextManager, nullcontext

import click

from haptigraph.commands.calibrating import devices_calibrate
from haptigraph.commands.help import TaskGroup, examples
from haptigraph.commands.options import procedure_option, profile_option
from haptigraph.commands.terminal import terminable
from haptigraph.errors import MissingExtra

__all__ = ["devices", "devices_auto_calibrate", "devices_test"]

SAFETY = "Research software: never use it on anyone whom a vibration, or its absence, could harm."


@click.group(
    cls=TaskGroup,
    tasks={
        "Try one": ("test",),
        "Measure its motor": ("auto-calibrate",),
        "Measure how strong it feels": ("calibrate",),
    },
    invoke_without_command=True,
    epilog=examples("haptigraph devices", "haptigraph devices test gamepad:0"),
)
@click.pass_context
def devices(context: click.Context) -> None:
    """List haptic devices, force devices and leaders on this machine, and what an extra would add.

    A device vibrates in the hand. A leader is moved by it, and steers a simulated or real robot; a force
    device does so too, and pushes the hand.
    """
    if context.invoked_subcommand is not None:
        return
    from rich.console import Console

    from haptigraph.analysis.actuators import actuators
    from haptigraph.run_force import force_devices_found
    from haptigraph.teleop.leaders.opening import leaders_found

    console = Console(markup=False, emoji=False, width=None if sys.stdout.isatty() else 160)
    with _one_network_search():
        table, sentences = actuators()
        leaders = leaders_found()
    console.print(table)
    for sentence in sentences:
        console.print(sentence)
    console.print("Try one: haptigraph devices test DEVICE. Use one: haptigraph run SOURCE --device DEVICE.")
    console.print("\nForce devices")
    for uri, what in force_devices_found().items():
        console.print(f"{uri:20} {what}")
    console.print("Try one: haptigraph devices test FORCE. Use one: haptigraph live teleop --force FORCE.")
    console.print("\nLeaders")
    for uri, what in leaders.items():
        console.print(f"{uri:12} {what}")
    console.print("Use one: haptigraph live teleop --leader LEADER.")
    console.print(SAFETY)


def _one_network_search() -> AbstractContextManager[None]:
    """Return the context in which the ROS 2 network is searched once, where that library is installed."""
    try:
        from haptigraph.ros2.topics import one_search
    except MissingExtra:
        return nullcontext()
    return one_search()


@devices.command(
    "test",
    epilog=examples(
        "haptigraph devices test gamepad:0",
        "haptigraph devices test 'serial:/dev/ttyACM0?pin=9'",
        "haptigraph devices test inverse3",
        "haptigraph devices test crtk:MTML --force",
    ),
)
@click.argument("device")
@click.option("--force", is_flag=True, help="DEVICE is a force device, where a name could be either.")
@procedure_option
@profile_option
def devices_test(device: str, force: bool, procedure: str | None, profile: str | None) -> None:
    """Play every pattern of the haptic grammar on DEVICE, and measure the round trip if it confirms.

    On a force device a soft wall, of at most 1 N, lies below the hand for ten seconds, while the clutch is
    held.
    """
    from haptigraph.analysis.actuators import play_grammar
    from haptigraph.assemble import DEVICES, load_procedure, open_device
    from haptigraph.clock import MonotonicClock
    from haptigraph.config import HapticsConfig, RunConfig
    from haptigraph.errors import DeviceError, NotSilent
    from haptigraph.haptics.profiles.profile import open_profile
    from haptigraph.run_force import FORCE_DEVICES

    kind = device.partition(":")[0]
    if force or (kind in FORCE_DEVICES and kind not in DEVICES):
        _try_force(device)
        return
    patterns = load_procedure(procedure or RunConfig().procedure).patterns
    measured, _ = open_profile(HapticsConfig(device=device, profile=profile or ""))
    opened = open_device(device)
    click.echo(SAFETY)
    with terminable():
        trial = play_grammar(opened, patterns, MonotonicClock(), click.echo, measured)
    if not trial.is_silent:
        raise NotSilent(device)
    if trial.faults:
        raise DeviceError(f"{device}: {trial.faults[0].message}")
    p50_ms, p99_ms = (trial.latencies.percentile_ms(percent) for percent in (50, 99))
    click.echo(f"{trial.count} commands, {p50_ms:.2f} ms each (p50), {p99_ms:.2f} ms (p99)")
    if trial.capabilities.answers:
        click.echo("the device confirmed each one, so this is the round trip")
    else:
        click.echo("the device confirms no command, so the delay until it vibrates is unknown")


@devices.command(
    "auto-calibrate",
    epilog=examples("haptigraph devices auto-calibrate 'drv2605:/dev/ttyACM0?motor=lra&rated_v=1.8'"),
)
@click.argument("device")
def devices_auto_calibrate(device: str) -> None:
    """Let a DRV2605L measure its motor, which vibrates for a second, and print the result as an option.

    Mount the motor and hold it as in use. The driver forgets the result without power.
    """
    from contextlib import closing

    from haptigraph.errors import BadInput
    from haptigraph.run_device import device_class

    kind, _, argument = device.partition(":")
    if kind != "drv2605":
        raise BadInput(f"only a drv2605 measures its motor, found {kind}", device)
    click.echo(SAFETY)
    with terminable(), closing(device_class(kind)(argument)) as opened:
        results = opened.calibrate()
    for number, result in enumerate(results, 1):
        resonance = f", resonance {result.resonance_hz:.0f} Hz" if result.resonance_hz else ""
        click.echo(
            f"driver {number}: compensation {result.compensation}, back EMF {result.back_emf}, "
            f"gain {result.gain}{resonance}"
        )
    click.echo(f"add to the device: &calibration={','.join(result.text for result in results)}")


def _try_force(name: str) -> None:
    from contextlib import closing

    from haptigraph.clock import MonotonicClock
    from haptigraph.config import HapticsConfig
    from haptigraph.haptics.force.trial import try_wall
    from haptigraph.run_force import open_force

    click.echo(f"{SAFETY}\nKeep the device's own switch at hand: it pushes.")
    with terminable(), closing(open_force(name, HapticsConfig().deadman_ms)) as process:
        trial = try_wall(process, MonotonicClock(), click.echo)
        click.echo(process.summary())
        for problem in process.take_problems():
            click.echo(f"released: {problem}")
    if not trial.has_begun:
        click.echo("the clutch was never held, so nothing pushed")
        return
    click.echo(f"at most {trial.most_n:.2f} N, {max(trial.deepest_mm, 0):.1f} mm beyond the wall")


devices.add_command(devices_calibrate)
