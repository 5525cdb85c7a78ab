"""Lines over pictures, icons and borders differ from what is behind them by 3:1 or more (WCAG 1.4.11), in both themes."""

import base64
from importlib.resources import files

import cv2
import pytest
from helpers import mostly_slow
from inspecting import use_theme
from paths import DATA

from haptigraph.perception.eye_view import IoctView
from haptigraph.registration.loading import load_registration, parse_registration
from haptigraph.sources.phantom import PhantomSource

pytestmark = pytest.mark.browser

CONTRAST = """
const linear = (part) => (part <= 0.04045 * 255 ? part / 255 / 12.92 : ((part / 255 + 0.055) / 1.055) ** 2.4);
const luminance = ([red, green, blue]) => 0.2126 * linear(red) + 0.7152 * linear(green) + 0.0722 * linear(blue);
const contrast = (one, other) => { const [a, b] = [luminance(one), luminance(other)].sort((x, y) => y - x); return (a + 0.05) / (b + 0.05); };
const rgb = (text) => text.match(/[\\d.]+/g).slice(0, 3).map(Number);
"""
OVERLAYS = (
    """async ({ picture, overlay }) => {"""
    + CONTRAST
    + """
  const { View } = await import("/static/common/view.js"), { page } = await import("/static/live/live.js");
  const canvas = document.createElement("canvas"), view = new View(canvas, null), side = canvas.width = canvas.height = 560;
  const needle = { needle_line: { type: "segment", start_mm: [6, 9], end_mm: [1, -6] }, needle_tip: { type: "point", at_mm: [1, -6] } };
  const all = page.hello.procedure.relations.map(({ subject, predicate, object }) => [subject, predicate, object]);
  view.begin(page.hello);
  view.picture = await createImageBitmap(new Blob([Uint8Array.from(atob(picture), (letter) => letter.charCodeAt(0))]));
  const pixels = (names, state, edges) => {
    view.choose(names);
    view.header = { found: needle, beside: [], sd_mm: { needle_tip: 0.8 }, edges, state };
    view.draw();
    return view.context.getImageData(0, 0, side, side).data;
  };
  const bare = pixels([], "", []);
  const at = (data, x, y) => data.slice(4 * (Math.round(y) * side + Math.round(x)), 4 * (Math.round(y) * side + Math.round(x)) + 3);
  const lines = overlay === "needle" ? [[needle.needle_line.start_mm, needle.needle_line.end_mm]]
    : overlay === "uncertainty" ? [Array.from({ length: 40 }, (_, n) => [1 + 1.6 * Math.cos(n), -6 + 1.6 * Math.sin(n)])]
    : view.zones.filter(({ kind }) => kind === overlay).map(({ outline }) => [...outline, outline[0]]);
  const found = [];
  for (const state of [...page.hello.procedure.states.map(({ name }) => name), ""]) {
    const drawn = pixels([overlay], state, state ? all : []);
    for (const line of lines) for (let n = 1; n < line.length; n++) for (const share of [0.2, 0.5, 0.8]) {
      const [x, y] = view.toCanvas([0, 1].map((axis) => line[n - 1][axis] * (1 - share) + line[n][axis] * share));
      if (x < 12 || y < 12 || x > side - 12 || y > side - 12) continue;
      let best = 0;
      for (let dx = -9; dx <= 9; dx++) for (let dy = -9; dy <= 9; dy++) best = Math.max(best, contrast(at(drawn, x + dx, y + dy), at(bare, x + dx, y + dy)));
      found.push([best, state]);
    }
  }
  return [found.length, ...found.reduce((worst, each) => (each[0] < worst[0] ? each : worst))];
}"""
)
EDGES = (
    "() => {"
    + CONTRAST
    + """
  const ground = (each) => { for (let at = each; at; at = at.parentElement) { const color = getComputedStyle(at).backgroundColor; if (!color.endsWith(", 0)")) return rgb(color); } };
  const shown = (selector) => [...document.querySelectorAll(selector)].filter((each) => each.checkVisibility() && !each.disabled);
  const worst = {};
  const note = (what, ratio) => { worst[what] = Math.min(worst[what] ?? Infinity, ratio); };
  for (const each of shown("button:not(#events button), select, input:not([type=checkbox], [type=radio], [type=range]), textarea"))
    note("control", Math.max(...[getComputedStyle(each).borderTopColor, getComputedStyle(each).backgroundColor].map((color) => contrast(rgb(color), ground(each.parentElement)))));
  for (const each of shown("svg .icon-edge")) note("icon", contrast(rgb(getComputedStyle(each).stroke), ground(each.closest("svg").parentElement)));
  for (const each of shown(".arrow-head, .transition, .relation path, .entity circle")) {
    const { fill, stroke } = getComputedStyle(each);
    if (!each.closest("defs")) note("drawing", contrast(rgb(stroke === "none" ? fill : stroke), ground(each.ownerSVGElement.parentElement)));
  }
  return worst;
}"""
)


def shipped_eyes():
    """Yield the first image of every phantom scenario and every rendered clip, as the live page shows it."""
    for file in files("haptigraph.sim").joinpath("scenarios").iterdir():
        if file.name.startswith("ioct"):
            continue
        source = PhantomSource(file.name.removesuffix(".toml"))
        yield (
            IoctView(parse_registration(source.registration, file.name), 560)(source.read(1).image),
            file.name,
        )
    for clip in sorted((DATA / "renderings").iterdir()):
        video = cv2.VideoCapture(str(clip / "clip.mp4"))
        ok, image = video.read()
        video.release()
        assert ok
        yield IoctView(load_registration(clip / "registration.toml"), 560)(image), clip.name


@pytest.fixture(scope="module")
def eyes():
    """The darkest and the brightest eye that ship, as PNG."""
    by_mean = sorted(shipped_eyes(), key=lambda each: each[0].mean())
    assert by_mean[-1][0].mean() > 1.5 * by_mean[0][0].mean()
    return {
        name: base64.b64encode(cv2.imencode(".png", image)[1]).decode()
        for name, (image, _) in (("darkest", by_mean[0]), ("brightest", by_mean[-1]))
    }


@pytest.mark.parametrize("eye", mostly_slow(["darkest", "brightest"], "brightest"))
def test_overlays_stand_out_from_the_eye(eyes, eye, live, open_page):
    page = open_page(live.url)
    for overlay in ("cone", "zone", "needle", "uncertainty"):
        count, ratio, state = page.evaluate(OVERLAYS, {"picture": eyes[eye], "overlay": overlay})
        assert count > 10
        assert ratio >= 3, (overlay, state)


@pytest.mark.parametrize("line", mostly_slow(["globe", "retina", "axis"], "axis"))
def test_lines_of_a_draft_stand_out_from_any_grey(line, live, open_page):
    page = open_page(f"{live.url}registration", module="/static/registration/registration.js", ready="true")
    worst = page.evaluate(
        """(line) => {"""
        + CONTRAST
        + """
  const stroke = (selector) => getComputedStyle(document.querySelector(selector)).stroke;
  const bright = rgb(stroke(`#overlay .${line}:not(.halo)`)), halo = stroke(`#overlay .halo.${line === "axis" ? "axis-halo" : line}`);
  const alpha = Number(halo.match(/[\\d.]+/g)[3] ?? 1), ratios = [];
  for (let grey = 0; grey < 256; grey++) ratios.push(Math.max(contrast(bright, [grey, grey, grey]), contrast(Array(3).fill(grey * (1 - alpha)), [grey, grey, grey])));
  return Math.min(...ratios);
}""",
        line,
    )
    assert worst >= 3


@pytest.mark.parametrize("theme", mostly_slow(["dark", "light"], "light"))
def test_icons_drawings_and_controls_stand_out_from_the_page(theme, live, open_page):
    page = open_page(live.url)
    use_theme(page, theme)
    page.wait_for_selector("#graph .relation.holds")
    worst = page.evaluate(EDGES)
    assert worst.keys() >= {"control", "icon", "drawing"}
    assert {what: ratio for what, ratio in worst.items() if ratio < 3} == {}
