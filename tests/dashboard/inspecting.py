"""Inspect an open page: what overlaps, is cut off or scrolls sideways, and what axe-core finds."""

import pytest
from paths import ROOT

__all__ = ["SIZES", "axe_violations", "layout_problems", "tab_to", "use_theme"]

SIZES = ((390, 844), (768, 1024), (1024, 768), (1280, 720), (1920, 1080))
"""A phone, a tablet both ways, a small laptop and a full-HD screen [px]."""
AXE = ROOT / "node_modules" / "axe-core" / "axe.min.js"
RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]
LAYOUT = """() => {
  const problems = [], name = (each) => `${each.tagName.toLowerCase()}#${each.id}.${each.getAttribute("class") ?? ""} '${each.textContent.trim().slice(0, 30)}'`;
  const boxOf = (each) => each.getBoundingClientRect();
  const isUnseen = (each) => each && (getComputedStyle(each).clipPath !== "none" || isUnseen(each.parentElement));  // for screen readers only
  const isShown = (each) => !isUnseen(each) && each.checkVisibility({ visibilityProperty: true }) && boxOf(each).width > 1 && boxOf(each).height > 1;
  const scrolls = (each) => ["auto", "scroll"].includes(getComputedStyle(each).overflowY);
  const modal = document.querySelector("dialog[open]");
  const all = [...(modal ?? document.body).querySelectorAll("*")].filter((each) => isShown(each) && !each.closest("svg svg, option"));
  const { scrollWidth, scrollHeight, clientHeight } = document.documentElement;
  if (scrollWidth > innerWidth) problems.push(`the page is ${scrollWidth} px wide`);
  for (const each of all) {
    const box = boxOf(each), style = getComputedStyle(each);
    const region = each.parentElement.closest(".scrolls, .panel, dialog"), isInSvg = each.ownerSVGElement;
    if (box.right > innerWidth + 1 || box.left < -1) problems.push(`beyond the window: ${name(each)}`);
    if (isInSvg || each.matches("svg, canvas, input, select, option, textarea, progress")) continue;
    const isShortened = style.textOverflow === "ellipsis" && each.title;
    if (style.overflowX !== "visible" && each.scrollWidth > each.clientWidth + 1 && !isShortened) problems.push(`${scrolls(each) ? "scrolls sideways" : "cut off"}: ${name(each)}`);
    if (style.overflowY === "hidden" && each.scrollHeight > each.clientHeight + 2 && !isShortened) problems.push(`cut off below: ${name(each)}`);
    if (region && !scrolls(region) && style.position !== "absolute" && boxOf(region).bottom + 1 < box.bottom && !each.closest("[class~=scrolls]")) problems.push(`beyond its panel: ${name(each)}`);
  }
  const hasText = (each) => [...each.childNodes].some((node) => node.nodeType === 3 && node.textContent.trim());
  const pieces = all.filter((each) => !each.ownerSVGElement && (hasText(each) || each.matches("button, input, select, textarea, canvas, svg, progress, img")));
  const isClipped = (each) => { const region = each.closest(".scrolls"); return region && (boxOf(each).bottom > boxOf(region).bottom + 1 || boxOf(each).top < boxOf(region).top - 1); };
  const flow = (one, other) => one.parentElement === other.parentElement && [one, other].every((each) => getComputedStyle(each).display === "inline");  // as words do
  const floats = (each) => each.closest(".over");  // meant to lie over a picture
  for (const [at, one] of pieces.entries()) for (const other of pieces.slice(at + 1)) {
    if (one.contains(other) || other.contains(one) || isClipped(one) || isClipped(other) || floats(one) || floats(other) || flow(one, other)) continue;
    const a = boxOf(one), b = boxOf(other);
    const across = Math.min(a.right, b.right) - Math.max(a.left, b.left), down = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
    if (across > 2 && down > 3) problems.push(`overlap: ${name(one)} and ${name(other)}`);
  }
  for (const each of document.querySelectorAll("#view, .stage")) {
    const { width, height } = boxOf(each);
    if (each.checkVisibility() && Math.min(width, height) < 200) problems.push(`a picture of ${Math.round(width)} x ${Math.round(height)} px`);
  }
  return [...new Set(problems)].slice(0, 12);
}"""


def layout_problems(page, size):
    """Return what is wrong with the page's layout in a window of a size [px]."""
    page.set_viewport_size({"width": size[0], "height": size[1]})
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return page.evaluate(LAYOUT)


def use_theme(page, theme):
    """Let the system prefer a theme, "light" or "dark"."""
    page.emulate_media(color_scheme=theme, reduced_motion="reduce")


def axe_violations(page, *, only_colors=False):
    """Return the violations of WCAG 2.2 AA and of good practice, or of the contrast of texts alone, one line each."""
    if not AXE.exists():
        pytest.skip("needs axe-core: make check installs it")
    if not page.evaluate("'axe' in window"):
        page.evaluate(AXE.read_text(encoding="utf-8"))
    rules = ["color-contrast"] if only_colors else RULES
    return page.evaluate(
        """(rules) => axe.run({ runOnly: rules }).then(({ violations }) => violations.flatMap(({ id, nodes }) => nodes.map((node) =>
             `${id}: ${node.target.join(" ")}: ${[...node.any, ...node.all, ...node.none].map((each) => each.message).join("; ")}`)))""",
        rules,
    )


def tab_to(page, selector):
    """Press Tab until an element has the focus, as somebody without a mouse does."""
    for _ in range(100):
        if page.evaluate("(selector) => document.activeElement.matches(selector)", selector):
            return
        page.keyboard.press("Tab")
    raise AssertionError(f"Tab does not lead to {selector}")
