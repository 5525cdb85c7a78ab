"""The page in a browser: it fits every window, is readable in both themes, and loads nothing else."""

from pathlib import Path

import pytest
from helpers import mostly_slow

from haptigraph.analysis.evidence.gathering import Results, safety_case
from haptigraph.analysis.evidence.page import page

pytestmark = pytest.mark.browser

CONTRASTS = """() => {
  const linear = (part) => (part <= 10.3 ? part / 3294 : ((part / 255 + 0.055) / 1.055) ** 2.4);
  const luminance = ([red, green, blue]) => 0.2126 * linear(red) + 0.7152 * linear(green) + 0.0722 * linear(blue);
  const rgb = (text) => text.match(/[\\d.]+/g).map(Number);
  const behind = (element) => {
    const color = rgb(getComputedStyle(element).backgroundColor);
    return color.length === 4 && color[3] === 0 ? behind(element.parentElement) : color;
  };
  const contrast = (one, other) => {
    const [a, b] = [luminance(one), luminance(other)].sort((x, y) => y - x);
    return (a + 0.05) / (b + 0.05);
  };
  const texts = [...document.querySelectorAll("h1, h2, p, li, li a, dt, dd, th, td, code")];
  return Math.min(...texts.map((text) => contrast(rgb(getComputedStyle(text).color), behind(text))));
}"""


@pytest.fixture(scope="module")
def address(tmp_path_factory) -> str:
    """The page of the default procedure without any results, which has much in red."""
    file: Path = tmp_path_factory.mktemp("page") / "evidence.html"
    file.write_text(page(safety_case("subretinal_injection", Results())))
    return file.as_uri()


@pytest.mark.parametrize("theme", mostly_slow(["light", "dark"], "light"))
@pytest.mark.parametrize("width", [390, 1280])
def test_it_fits_is_readable_and_loads_nothing_else(chromium, address, width, theme):
    context = chromium.new_context(viewport={"width": width, "height": 844}, color_scheme=theme)
    try:
        opened, requests = context.new_page(), []
        opened.on("request", lambda request: requests.append(request.url))
        opened.goto(address)
        assert requests == [address]
        assert opened.evaluate("document.documentElement.scrollWidth") == width
        assert opened.evaluate(CONTRASTS) >= 4.5
        ground = opened.evaluate("getComputedStyle(document.body).backgroundColor")
        assert ground == ("rgb(255, 255, 255)" if theme == "light" else "rgb(18, 23, 28)")
        bad = opened.evaluate(
            "[...document.querySelectorAll('tr.bad .status')].map((cell) => cell.innerText)"
        )
        assert bad and all("MISSING" in text for text in bad)
    finally:
        context.close()
