"""The static files: they refer to no other host, and scripts know the elements of the pages."""

import re

from haptigraph.dashboard.server.server import STATIC

ELEMENT_TYPES = {
    "HTMLButtonElement": "button",
    "HTMLCanvasElement": "canvas",
    "HTMLDialogElement": "dialog",
    "HTMLFieldSetElement": "fieldset",
    "HTMLFormElement": "form",
    "HTMLImageElement": "img",
    "HTMLInputElement": "input",
    "HTMLProgressElement": "progress",
    "HTMLSelectElement": "select",
    "HTMLTextAreaElement": "textarea",
    "SVGSVGElement": "svg",
}


def test_static_files_are_short_and_refer_to_no_other_host():
    for file in STATIC.rglob("*.*"):
        text = file.read_text(encoding="utf-8").replace("http://www.w3.org/2000/svg", "")
        assert "http://" not in text and "https://" not in text, file.name
        assert len(text.splitlines()) <= 250, file.name


def test_elements_that_scripts_find_by_id_are_on_the_pages_with_their_type():
    pages = "".join(file.read_text(encoding="utf-8") for file in STATIC.rglob("*.html"))
    tags: dict[str, set[str]] = {}
    for tag, identifier in re.findall(r'<(\w+)[^>]*?\bid="([^"]+)"', pages):
        tags.setdefault(identifier, set()).add(tag)
    declared = STATIC.joinpath("types", "page_elements.d.ts").read_text(encoding="utf-8")
    groups = re.findall(r"Record<([^,]*), *\n? *(\w+)>", declared)
    assert {kind for _, kind in groups} >= ELEMENT_TYPES.keys()
    for names, kind in groups:
        for identifier in re.findall(r'"([^"]+)"', names):
            assert identifier in tags, identifier
            assert kind not in ELEMENT_TYPES or tags[identifier] == {ELEMENT_TYPES[kind]}, identifier
