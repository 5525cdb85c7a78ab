"""The house keeps its laws: layers, complete __all__, units in names, no clock and no print in stages."""

import ast
import importlib
import pkgutil
from pathlib import Path

import pytest
from importlinter.cli import lint_imports

import haptigraph

ROOT = Path(haptigraph.__file__).parent
MODULES = sorted(module.name for module in pkgutil.walk_packages([str(ROOT)], "haptigraph."))
FILES = sorted(ROOT.rglob("*.py"))
STAGES = ("perception", "scene", "inference")
UNITS = {
    "mm",
    "um",
    "pt",  # of print
    "px",
    "n",
    "mj",
    "kg",
    "db",
    "deg",
    "rad",
    "px2",
    "ns",
    "ms",
    "s",
    "hz",
    "grey",
    "mb",
    "rows",
    "steps",
    "s2",
    "v",
}
# Numbers without a unit: ratios and counts, and the paper's alpha.
UNITLESS = {
    "alpha", "amplitude", "percent", "value", "at_most", "below", "at_least", "above", "release",
    "resolution", "vignetting", "exposure", "shadow", "brightness", "highlight", "texture", "bowl_shade", "motion_scale", "loss",
    "max_amplitude", "contrast", "a", "b", "x", "y", "r", "g", "most", "wanted", "diameter", "thickness",
    "font_size", "theta_integral", "offset_grey", "mm_per_px", "px_per_mm", "left", "top", "right", "bottom",
    "low", "high", "rim_ratio", "reach_ratio", "support_ratio", "half_width", "radius", "inner", "scale", "scale_sd",
    "lag_images", "mm_s", "deg_s", "flicker", "confidence", "slope", "share", "share_sd", "scatter", "one_tone",
    "least", "way", "given_alpha",
    "curve", "dead_band", "statistic", "p", "z", "holm_p", "effect", "mean_difference", "strength", "absolute_threshold",
    "distance_sd_share", "motor_sd_share", "weber_fraction", "attention_probability", "align_share", "changes_per_min",
    "w", "t", "df", "d", "opposite", "mean", "sd", "median", "lower", "upper",
    "difference", "error", "estimate", "observed", "detectable_d", "needed", "score", "from_score",
    "participant_sd", "residual_sd", "width", "height",
    "weakest_amplitude", "sham_duty", "least_confidence", "across", "down", "depth_share", "target_share", "chance", "chroma_share", "light",
    "equal_share", "min_ridge_share", "max_tissue_share", "top_share", "body_share", "min_rise_share", "min_band_share",
    "bright_share", "gap_share", "differing_sds", "lit_share", "rise_share", "sd_share", "scatter_share", "min_contrast_sd", "min_band_sd", "slope_sd", "min_gain", "steepest", "side",
    "lowest_slope", "highest_slope",
    "bound_low", "bound_high", "p_t", "level", "total", "tail", "center", "half_range", "beta", "odds_ratio",
    "back", "towards", "apart", "deflection", "limit", "rim_ratio_sd", "wall_ratio", "wall_ratio_sd", "closeness", "closeness_sd",
    "drive", "max_drive", "intensity", "lowest", "largest",
    "coverage", "explained_share", "cost", "cost_limit", "depth_cost", "inside", "knee", "noise", "log_likelihood",
}  # fmt: skip


def test_no_folder_holds_more_than_a_reader_can_take_in():
    tests = ROOT.parent / "tests"
    folders = {path.parent for root in (ROOT, tests) for path in root.rglob("*.*")} - {ROOT}
    for folder in folders:
        for suffix in (".py", ".c", ".js"):
            modules = [path for path in folder.glob(f"*{suffix}") if path.name != "__init__.py"]
            assert len(modules) <= 16, f"{folder}: {len(modules)} {suffix}"


def test_the_layers_of_all_rooms_are_kept_and_no_import_goes_in_a_circle():
    assert lint_imports(config_filename=str(ROOT.parent / "pyproject.toml"), no_cache=True) == 0


def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


def test_public_names_are_complete_and_sorted():
    names = [name for name in MODULES if not name.endswith("__main__")]
    assert len(names) > 700
    assert {name: wrong for name in names if (wrong := wrong_public_names(name))} == {}


def wrong_public_names(name: str) -> list[str]:
    """The names that a module lists but lacks, those that it does not list, and all if they are not sorted."""
    module = importlib.import_module(name)
    if Path(module.__file__).name == "__init__.py":
        return []
    defined = {
        node.name
        for node in parsed(Path(module.__file__)).body
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and not node.name.startswith("_")
    }
    listed = list(module.__all__)
    absent = [item for item in listed if not hasattr(module, item)]
    missing = defined - set(listed) - set(PRIVATE.get(name, ()))
    is_sorted = listed == sorted(listed, key=lambda item: (not item.isupper(), not item[0].isupper(), item))
    return [*absent, *missing, *(() if is_sorted else listed)]


PRIVATE = {
    "haptigraph.cli": ("Commands",),
    "haptigraph.sim.eye.painter": ("Palette",),
    "haptigraph.sim.scenario": ("About",),
    "haptigraph.scene.relations": (
        "distance_mm", "tip_disagreement_mm", "radial_mm", "theta_deg", "wall_mm", "clearance_mm", "aside_mm", "elapsed_s",
        "gap_um", "incidence_deg", "depth_percent", "thickness_um", "out_of_plane_um",
    ),
    "haptigraph.recording.foxglove": (
        "CircleAnnotation", "Color", "Point2", "PointsAnnotation", "Pose", "Rotation", "TextAnnotation", "Vector3",
    ),
}  # fmt: skip


def test_the_package_offers_what_it_says():
    assert sorted(haptigraph.__all__) == haptigraph.__all__
    for name in haptigraph.__all__:
        assert getattr(haptigraph, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = haptigraph.nothing


def floats_without_unit(tree: ast.Module) -> list[str]:
    """Public float parameters and fields whose name says no unit."""
    named: list[tuple[str, ast.expr | None]] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            named += [
                (argument.arg, argument.annotation) for argument in node.args.args + node.args.kwonlyargs
            ]
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            named.append((node.target.id, node.annotation))
    wrong = []
    for name, annotation in named:
        is_float = annotation is not None and ast.unparse(annotation) in ("float", "float | None", "Positive")
        if is_float and name.rpartition("_")[2] not in UNITS and name not in UNITLESS:
            wrong.append(name)
    return wrong


def in_files(find, files: list[Path]) -> dict[str, object]:
    """What is found in each file in which something is."""
    return {str(path.relative_to(ROOT)): found for path in files if (found := find(path))}


def test_names_of_numbers_carry_their_unit():
    def wrong(path: Path) -> list[str]:
        return [name for name in floats_without_unit(parsed(path)) if not name.endswith(("mm_s", "deg_s"))]

    assert len(FILES) > 700
    assert in_files(wrong, FILES) == {}


def test_stages_know_no_clock_no_chance_and_no_output():
    stages = [path for path in FILES if path.relative_to(ROOT).parts[0] in STAGES]
    assert len(stages) > 100
    assert in_files(forbidden_imports, stages) == {}


def forbidden_imports(path: Path) -> set[str]:
    imported = set()
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            imported |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            imported.add((node.module or "").partition(".")[0])
    return imported & {"time", "datetime", "random", "sys", "logging", "threading", "os"}


def test_files_stay_small():
    def lines_beyond(path: Path) -> list[str]:
        return path.read_text().splitlines()[330:]

    assert len(FILES) > 700
    assert in_files(lines_beyond, FILES) == {}
