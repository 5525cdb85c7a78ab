"""Commands for haptic patterns and files: touch convert, touch draw, touch play, touch formats."""

import click

from haptigraph.commands.devices import SAFETY
from haptigraph.commands.help import TaskGroup, examples
from haptigraph.commands.terminal import print_status, terminable

__all__ = ["convert", "draw", "formats", "play", "touch"]

seconds_option = click.option(
    "--seconds",
    "length_s",
    type=click.FloatRange(0.1, 60),
    default=2.0,
    show_default=True,
    help="How long a pattern lasts that does not end by itself, to the nearest period.",
)


@click.group(
    cls=TaskGroup,
    tasks={"See and feel it": ("draw", "play"), "Exchange it": ("convert", "formats")},
    epilog=examples(
        "haptigraph touch draw subretinal_injection:pulse -o pulse.svg",
        "haptigraph touch convert subretinal_injection:pulse -o pulse.ahap",
    ),
)
def touch() -> None:
    """Draw, play and convert a single vibration: a pattern of a procedure, or a haptic designer's file.

    Files are .haptic (Meta Haptics Studio), .ahap (Apple Core Haptics), .hjif (MPEG haptics; not checked
    against a reference reader) and .wav. States, priorities and limits stay in the procedure and the guard.
    """


@touch.command(
    epilog=examples(
        "haptigraph touch convert subretinal_injection:pulse -o pulse.haptic",
        "haptigraph touch convert click.ahap -o click.toml",
        "haptigraph touch convert rumble.wav -o rumble.toml --approximate",
    )
)
@click.argument("source")
@click.option("-o", "--output", metavar="FILE", required=True, help=".toml, .haptic, .ahap, .hjif or .wav.")
@seconds_option
@click.option("--approximate", is_flag=True, help="To .toml: write a pattern even if it does not fit.")
def convert(source: str, output: str, length_s: float, approximate: bool) -> None:
    """Convert SOURCE to a new file, read it back, and report the error of the round trip.

    SOURCE is PROCEDURE:PATTERN, FILE.toml:PATTERN, FILE.toml with one pattern, or a .haptic, .ahap, .hjif or
    .wav file. To .toml, a pattern fits if its amplitude is within 1 % and its steps are within 2 ms; a
    vibration that none fits is refused, with the error. HJIF is not checked against a reference reader.
    """
    from haptigraph.analysis.touch.converting import convert_touch, difference_text, pattern_text
    from haptigraph.haptics.formats.files import FORMATS

    done = convert_touch(source, output, length_s * 1e3, approximate=approximate)
    for note in done.source.envelope.notes:
        print_status(f"haptigraph: {source}: {note}")
    pattern = done.written.pattern
    what = pattern_text(pattern) if pattern is not None else "no single pattern"
    click.echo(f"{output}  {what}")
    click.echo(f"round trip: {difference_text(done.error)}")
    caution = next((form.caution for end, form in FORMATS.items() if output.lower().endswith(end)), "")
    if caution:
        print_status(f"haptigraph: {output}: {caution}")


@touch.command(
    epilog=examples(
        "haptigraph touch draw subretinal_injection:success -o success.svg",
        "haptigraph touch draw click.ahap -o click.png",
    )
)
@click.argument("source")
@click.option("-o", "--output", metavar="FILE", required=True, help="SVG, PNG or PDF to write.")
@seconds_option
def draw(source: str, output: str, length_s: float) -> None:
    """Draw amplitude and frequency of SOURCE over time.

    SOURCE is as for `touch convert`.
    """
    from haptigraph.analysis.touch.figure import draw_touch
    from haptigraph.analysis.touch.loading import load_touch

    draw_touch(load_touch(source, length_s * 1e3), output)
    click.echo(output)


@touch.command(
    epilog=examples(
        "haptigraph touch play subretinal_injection:pulse --device gamepad:0",
        "haptigraph touch play click.ahap --device audio --max-amplitude 0.5",
    )
)
@click.argument("source")
@click.option(
    "--device", metavar="DEVICE", required=True, help="What vibrates; `haptigraph devices` lists all."
)
@click.option(
    "--max-amplitude",
    type=click.FloatRange(0, 1),
    default=1.0,
    show_default=True,
    help="Limit of the guard.",
)
@seconds_option
def play(source: str, device: str, max_amplitude: float, length_s: float) -> None:
    """Play SOURCE once on DEVICE, through the guard and within its limits.

    SOURCE is as for `touch convert`; no file can lift a limit. Try a file of somebody else with the actuator
    in your own hand first, and with a low --max-amplitude.
    """
    from haptigraph.analysis.touch.converting import pattern_text
    from haptigraph.analysis.touch.loading import load_touch
    from haptigraph.analysis.touch.playing import play_touch
    from haptigraph.assemble import open_device
    from haptigraph.clock import MonotonicClock
    from haptigraph.config import HapticsConfig
    from haptigraph.errors import DeviceError, NotSilent
    from haptigraph.haptics.pattern import unsupported

    loaded = load_touch(source, length_s * 1e3)
    opened = open_device(device)
    click.echo(SAFETY)
    for note in loaded.envelope.notes:
        print_status(f"haptigraph: {source}: {note}")
    pattern = loaded.pattern
    what = pattern_text(pattern) if pattern is not None else f"amplitude up to {loaded.envelope.peak:.2g}"
    click.echo(f"{loaded.name}  {what}, for {loaded.envelope.duration_ms / 1e3:g} s")
    for note in unsupported(pattern, opened.capabilities) if pattern is not None else ():
        print_status(f"haptigraph: {device}: {note}")
    with terminable():
        test = play_touch(opened, loaded, MonotonicClock(), HapticsConfig(max_amplitude=max_amplitude))
    if not test.is_silent:
        raise NotSilent(device)
    if test.faults:
        raise DeviceError(f"{device}: {test.faults[0].message}")


@touch.command(epilog=examples("haptigraph touch formats"))
@seconds_option
def formats(length_s: float) -> None:
    """List the formats, and measure the round trip of every shipped pattern through each.

    Errors are the largest of all patterns: amplitude in percent of the pattern's, steps in ms.
    """
    from haptigraph.analysis.touch.converting import difference_text, round_trips
    from haptigraph.haptics.formats.files import FORMATS

    for ending, count, kept, worst in round_trips(length_s * 1e3):
        form = FORMATS[ending]
        caution = f"; {form.caution}" if form.caution else ""
        click.echo(f"{ending:8} {form.title}{caution}")
        click.echo(
            f"{'':8} {count} patterns, {kept} of the same kind; largest error: {difference_text(worst)}"
        )
