"""Messages that differ, in words."""

import json

from haptigraph.analysis.metrics.differing import differing_parts, largest_difference


def parts(before, after):
    return differing_parts(json.dumps(before).encode(), json.dumps(after).encode())


def edge(predicate):
    return {"subject": "needle_tip", "predicate": predicate, "object": "retina_surface"}


def test_only_what_differs_is_named():
    before = {"state": "a", "measures": {"theta_deg": 1.5, "radial_mm": 2.0}, "edges": [edge("approaching")]}
    after = {
        "state": "a",
        "measures": {"theta_deg": 1.75, "radial_mm": 2.0},
        "edges": [edge("approaching"), edge("touching")],
    }
    assert parts(before, after) == (
        "measures theta_deg 1.5",
        "measures theta_deg 1.75; edges needle_tip touching retina_surface",
    )


def test_a_part_that_one_message_lacks_is_named_by_the_other():
    assert parts({}, {"tip": [1.0, 2.0]}) == ("(nothing else)", "tip 1.0, 2.0")


def test_many_differences_are_counted():
    first, _ = parts({str(n): n for n in range(9)}, {str(n): -1 - n for n in range(9)})
    assert first == "0 0; 1 1; 2 2; 3 3; and 5 more"


def test_the_largest_difference_is_that_of_numbers_if_nothing_else_differs():
    before = {"found": {"tip": (1.0, 2.0)}, "number": 3, "name": "a"}
    assert largest_difference(before, before) == 0
    assert largest_difference(before, {**before, "found": {"tip": (1.5, 1.75)}}) == 0.5
    for other in ({"name": "b"}, {"number": 4}, {"found": {"tip": (1.0,)}}, {"found": {}}, {"more": 1.0}):
        assert largest_difference(before, {**before, **other}) is None
