"""The assembled rig -> bill of materials and print settings, as CSV and Markdown."""

import csv
import io
from collections import Counter
from collections.abc import Iterable, Mapping

import trimesh
from msgspec import Struct

from rig.assembly import Body, screws_of
from rig.checks.all_checks import Checked
from rig.layout import Layout
from rig.meshes import on_bed
from rig.parts.light import LEDS
from rig.standard import MOTOR_MM

__all__ = ["Item", "bill_csv", "bill_md", "bill_of", "checks_md", "settings_md"]

PLA_G_CM3 = 1.24
SHELL_SHARE = 0.35
"""Of a part's volume that is shell at two walls and four layers; the rest is infill. A rough figure."""


class Item(Struct, frozen=True):
    """One line of the bill of materials."""

    quantity: int
    item: str
    note: str


def bill_of(layout: Layout, bodies: Iterable[Body]) -> list[Item]:
    """Return what is printed and what is bought."""
    rig = layout.rig
    printed = Counter(body.kind for body in bodies if body.print)
    notes = {body.kind: f"{body.print.material}, {body.print.color}" for body in bodies if body.print}
    items = [
        Item(count, name.replace("_", " "), f"printed: {notes[name]}")
        for name, count in sorted(printed.items())
    ]
    screws = Counter((screw.size_mm, screw.length_mm) for screw in screws_of(layout))
    items += [
        Item(
            count,
            f"screw M{size:g} x {length:g}, cylinder head",
            "ISO 4762" if size >= 3 else "ISO 7045 or ISO 4762",
        )
        for (size, length), count in sorted(screws.items())
    ]
    inserts = sum(count for (size, _), count in screws.items() if size >= 3)
    items.append(
        Item(
            inserts, "heat-set insert M3, 4.6 mm outside, 4 to 5 mm long", "pressed in with a soldering iron"
        )
    )
    for mirror in rig.mirrors:
        width, length = mirror.size_mm
        name = f"front-surface mirror, {width:g} x {length:g} x {mirror.thickness_mm:g} mm"
        items.append(Item(1, name, "first-surface aluminium; an ordinary mirror makes double images"))
    items += [
        Item(1, f"camera: {rig.camera.model}", rig.camera.source),
        Item(LEDS, "LED 5 mm, white, 60°, 20 mA", "in the light's holes"),
        Item(LEDS, "resistor 100 Ω, 0.25 W", "one in series with each LED, at 5 V; 20 mA for a 3.0 V LED"),
        Item(1, "supply 5 V, at least 0.5 A, with switch", "the LEDs are on only while it is switched on"),
        Item(
            1,
            f"coin motor, {MOTOR_MM[0]:g} x {MOTOR_MM[1]:g} mm, ERM or LRA",
            "with the actuator clip; see docs/how_to/devices.md",
        ),
    ]
    return items


def bill_csv(items: Iterable[Item]) -> str:
    """Return the bill as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["quantity", "item", "note"])
    writer.writerows([item.quantity, item.item, item.note] for item in items)
    return text.getvalue()


def bill_md(name: str, items: Iterable[Item]) -> str:
    """Return the bill as a Markdown table."""
    rows = [f"| {item.quantity} | {item.item} | {item.note} |" for item in items]
    return "\n".join([f"# Bill of materials: {name}", "", "| n | item | note |", "|---|---|---|", *rows, ""])


def settings_md(name: str, bodies: Iterable[Body], meshes: Mapping[str, trimesh.Trimesh]) -> str:
    """Return how each part is printed, as Markdown; the STL files lie as stated."""
    lines = [
        f"# Print settings: {name}",
        "",
        "Nozzle 0.4 mm, 3 walls. The STL files lie as printed. Mass: roughly, without supports.",
        "",
        "| part | lies on | supports | material, colour | layer | infill | size [mm] | mass [g] | note |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    done = set()
    for body in bodies:
        if not body.print or body.kind in done:
            continue
        done.add(body.kind)
        how, mesh = body.print, meshes[body.name]
        size = " x ".join(f"{side:.0f}" for side in on_bed(mesh, how).extents)
        share = min(1.0, SHELL_SHARE + how.infill_percent / 100)
        cells = [
            body.kind.replace("_", " "),
            how.lies_on,
            how.supports or "none",
            f"{how.material}, {how.color}",
            f"{how.layer_mm:g} mm",
            f"{how.infill_percent:g} %",
            size,
            f"{mesh.volume / 1000 * PLA_G_CM3 * share:.0f}",
            how.note,
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join([*lines, ""])


def checks_md(name: str, checked: Checked) -> str:
    """Return what was measured, as Markdown."""
    lines = [
        f"# Checks: {name}",
        "",
        "## Between bodies",
        "",
        "| bodies | relation | stated [mm] | measured [mm] |",
        "|---|---|---|---|",
    ]
    lines += [
        f"| {' - '.join(gap.names)} | {gap.kind} | "
        f"{'at least ' if gap.kind == 'apart' else ''}{gap.wanted_mm:g} | "
        f"{'2 or more' if gap.gap_mm >= 2 else f'{gap.gap_mm:.2f}'} |"
        for gap in checked.gaps
        if gap.kind != "screw"
    ]
    lines += ["", f"{sum(gap.kind == 'screw' for gap in checked.gaps)} pairs with a screw: none overlaps."]
    lines += [
        "",
        "## Printed parts",
        "",
        "| part | thinnest [mm] | overhangs | widest [mm] |",
        "|---|---|---|---|",
    ]
    for part, thinnest_mm in sorted(checked.thinnest_mm.items()):
        found = checked.overhangs[part]
        widest = f"{found[0].width_mm:.1f}" if found else "-"
        lines.append(f"| {part.replace('_', ' ')} | {thinnest_mm:.2f} | {len(found)} | {widest} |")
    return "\n".join([*lines, ""])
