"""What the numbers of a scenario mean in its eye: lengths, and the poses of its script."""

from haptigraph.analysis.plots.svg import FONT, text_svg
from haptigraph.geometry import Point, Polyline, Vec, distance_to_line, norm, rotate, subtract, unit
from haptigraph.scene.relations import distance_mm
from haptigraph.sim.eye.eye import Eye
from haptigraph.sim.scenario import Scenario

__all__ = ["scenario_svg"]

WIDTH, TOP = 1000, 560
CENTER, ROOM_PX = (270.0, 325.0), 200.0
ARC_MM, SHAFT_MM, CLOSE_MM = 6.0, 4.0, 1.3
CONTACT_MM = 0.7
DIM, RETINA, AXIS, SHAFT = "#5f6670", "#b8434e", "#1f5fa8", "#333333"
COLUMNS = {"move": 570, "depth_mm": 665, "theta_deg": 755, "to the retina": 865, "off the axis": 970}
LEFT, ROW, FIRST = 530, 20, 118
Pose = tuple[float, float]


def scenario_svg(scenario: Scenario) -> str:
    """Return what a scenario's numbers mean as SVG: its eye on the left, its moves on the right."""
    eye = _Eye(Eye(scenario.eye))
    poses: dict[Pose, list[int]] = {}
    for number, move in enumerate(scenario.moves, 1):
        if not move.away:
            poses.setdefault((move.depth_mm, move.theta_deg), []).append(number)
    height = max(TOP, FIRST + ROW * (len(poses) + 9))
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" '
        f'height="{height}" {FONT}>',
        f'<rect width="{WIDTH}" height="{height}" fill="#ffffff"/>',
        text_svg(WIDTH / 2, 30, scenario.about.description, size_px=13, weight="bold"),
        *eye.anatomy(),
        *eye.shafts(list(poses)),
        *eye.tips(poses),
        *_table(eye, poses),
    ]
    return "\n".join([*parts, "</svg>", ""])


class _Eye:
    """An eye on paper: frontal view, as in the eye frame."""

    def __init__(self, eye: Eye) -> None:
        self._eye = eye
        self._px_per_mm = ROOM_PX / (eye.radius_mm + eye.shape.wall_mm)
        self._side = 1 if eye.trocar_mm[0] > 0 else -1

    def tip_mm(self, depth_mm: float, theta_deg: float) -> Vec:
        """Return where the tip of a pose is [mm], eye frame."""
        x, y = rotate(unit(subtract(self._eye.target_mm, self._eye.trocar_mm)), theta_deg)
        return self._eye.trocar_mm[0] + depth_mm * x, self._eye.trocar_mm[1] + depth_mm * y

    def to_retina_mm(self, tip_mm: Vec) -> float:
        """Return the distance to the retina, negative beyond it."""
        found = {"trocar": Point(self._eye.trocar_mm)}
        return distance_mm(Point(tip_mm), Polyline(self._eye.retina_mm), found) or 0.0

    def off_axis_mm(self, tip_mm: Vec) -> float:
        """Return the distance from the line trocar -> target."""
        return distance_to_line(tip_mm, self._eye.trocar_mm, self._eye.target_mm)

    def anatomy(self) -> list[str]:
        """Draw globe, retina, trocar and target."""
        eye, side = self._eye, self._side
        outer_mm = eye.radius_mm + eye.shape.wall_mm
        trocar, target = f"trocar_deg {eye.shape.trocar_deg:g}", f"target_deg {eye.shape.target_deg:g}"
        angles_deg = [eye.shape.retina_half_deg * (step / 25 - 1) for step in range(51)]
        near = tuple(eye.on_retina(angle_deg, CONTACT_MM) for angle_deg in angles_deg)
        mark = eye.target_mm, eye.on_retina(eye.shape.target_deg, -eye.shape.wall_mm)
        return [
            self._circle((0.0, 0.0), outer_mm * self._px_per_mm, "#f3e7dc", DIM),
            self._circle((0.0, 0.0), eye.radius_mm * self._px_per_mm, "#ffffff", DIM),
            self._line(eye.retina_mm, RETINA, 4),
            self._line(near, RETINA, 1, "3 3"),
            self._line(mark, RETINA, 5),
            self._circle(eye.trocar_mm, 6, AXIS, "#ffffff"),
            self._text(eye.trocar_mm, trocar, AXIS, (14 * side, -16), "start" if side > 0 else "end"),
            self._text(mark[1], target, RETINA, (0, 20), "middle"),
        ]

    def legend(self) -> list[tuple[str, str]]:
        """Say what lines and columns are: text and colour."""
        eye = self._eye
        reach_mm = norm(subtract(eye.target_mm, eye.trocar_mm))
        return [
            (f"globe: {eye.shape.diameter_mm:g} mm wide inside", DIM),
            (f"dashed line: the axis, {reach_mm:.1f} mm from trocar to target", AXIS),
            (f"thick line: the retina; dotted: {CONTACT_MM} mm above it, contact in the paper", RETINA),
            ("trocar_deg from the top, target_deg from the bottom; positive: right", DIM),
            ("numbers: the tip at the end of a move", SHAFT),
            ("depth_mm: along the shaft from trocar to tip, negative outside", SHAFT),
            ("theta_deg: from the axis, counter-clockwise about the trocar", SHAFT),
            ("to the retina, off the axis: what distance_mm and radial_mm measure there", SHAFT),
        ]

    def shafts(self, poses: list[Pose]) -> list[str]:
        """Draw the needle in every pose, the axis, and the largest angle at the trocar."""
        parts = [
            self._line(
                (self.tip_mm(min(0.0, depth_mm) - SHAFT_MM, theta_deg), self.tip_mm(depth_mm, theta_deg)),
                SHAFT,
                1.4,
            )
            for depth_mm, theta_deg in poses
        ]
        widest = max((theta_deg for _, theta_deg in poses), key=abs, default=0.0)
        if widest:
            arc = tuple(self.tip_mm(ARC_MM, widest * step / 12) for step in range(13))
            clear_px = 10 if (arc[-1][0] > arc[0][0]) else -10
            label = f"theta_deg {widest:g}"
            parts += [
                self._line(arc, SHAFT, 2.5),
                self._text(arc[-1], label, SHAFT, (clear_px, 12), "start" if clear_px > 0 else "end"),
            ]
        return [*parts, self._line((self._eye.trocar_mm, self._eye.target_mm), AXIS, 2, "7 5")]

    def tips(self, poses: dict[Pose, list[int]]) -> list[str]:
        """Number the tips with their moves; those close to each other share a sign."""
        signs: list[tuple[Vec, list[int]]] = []
        for pose, numbers in poses.items():
            tip = self.tip_mm(*pose)
            near = next((named for at, named in signs if norm(subtract(at, tip)) < CLOSE_MM), None)
            if near is None:
                signs.append((tip, list(numbers)))
            else:
                near += numbers
        parts = []
        for tip, numbers in signs:
            text, (x, y) = _ranges(numbers), self._at(tip)
            width = 8 + 7.5 * len(text)
            parts += [
                f'<rect x="{x - width / 2:.1f}" y="{y - 9:.1f}" width="{width:g}" height="18" rx="9" '
                f'fill="#ffffff" stroke="{SHAFT}"/>',
                self._text(tip, text, SHAFT, (0, 4.5), "middle"),
            ]
        return parts

    def _at(self, point_mm: Vec) -> Vec:
        return CENTER[0] + point_mm[0] * self._px_per_mm, CENTER[1] - point_mm[1] * self._px_per_mm

    def _line(self, points_mm: tuple[Vec, ...], color: str, width: float, dash: str = "") -> str:
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in map(self._at, points_mm))
        dashes = f' stroke-dasharray="{dash}"' if dash else ""
        return f'<polyline points="{path}" fill="none" stroke="{color}" stroke-width="{width:g}"{dashes}/>'

    def _circle(self, at_mm: Vec, radius_px: float, fill: str, stroke: str) -> str:
        x, y = self._at(at_mm)
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius_px:.1f}" fill="{fill}" stroke="{stroke}"/>'

    def _text(self, at_mm: Vec, text: str, color: str, off_px: Vec, anchor: str) -> str:
        x, y = self._at(at_mm)
        return text_svg(
            round(x + off_px[0], 1), round(y + off_px[1], 1), text, size_px=12.5, color=color, anchor=anchor
        )


def _table(eye: _Eye, poses: dict[Pose, list[int]]) -> list[str]:
    """List every pose, and what the rules measure there."""
    rows = [(text_x, FIRST - 28, name, DIM) for name, text_x in COLUMNS.items()]
    for row, ((depth_mm, theta_deg), numbers) in enumerate(poses.items()):
        tip = eye.tip_mm(depth_mm, theta_deg)
        cells = (
            _ranges(numbers), f"{depth_mm:g}", f"{theta_deg:g}",
            f"{eye.to_retina_mm(tip):.1f} mm", f"{eye.off_axis_mm(tip):.1f} mm",
        )  # fmt: skip
        rows += [(x, FIRST + ROW * row, cell, SHAFT) for x, cell in zip(COLUMNS.values(), cells, strict=True)]
    below = FIRST + ROW * len(poses) + 18
    legend = [(LEFT, below + ROW * at, *line) for at, line in enumerate(eye.legend())]
    return [
        *(text_svg(x, y, text, size_px=12.5, color=color, anchor="end") for x, y, text, color in rows),
        *(text_svg(x, y, text, size_px=12, color=color, anchor="start") for x, y, text, color in legend),
    ]


def _ranges(numbers: list[int]) -> str:
    """Return ascending numbers as text, with a dash where they follow on each other."""
    runs: list[list[int]] = []
    for number in sorted(numbers):
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return ", ".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else str(run[0]) for run in runs)
