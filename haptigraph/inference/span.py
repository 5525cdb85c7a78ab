"""From where to where the measures of a run are taken, as a procedure says it; as in the paper by default.

Knows no measure and no step; running a procedure needs none of it.
"""

from msgspec import Struct

from haptigraph.graph import Names, Schema, Triplet
from haptigraph.inference.pattern_check import check_known
from haptigraph.toml_document import Document

__all__ = ["RunSpan", "check_span"]


class RunSpan(Struct, frozen=True, forbid_unknown_fields=True):
    """A run begins when an edge is first there, and ends in a state (paper, section III)."""

    begins: Names = ("needle_tip", "inside", "eye_globe")
    """The edge whose first appearance begins it."""
    ends_in: str = "target_hit"
    """The state whose first appearance ends it."""
    contact_in: str = "retinal_contact"
    """The state that counts as an unintended contact."""

    def is_told_by(self, schema: Schema) -> bool:
        """Tell whether a schema has the edge that begins a run; without it none ever begins."""
        return any(relation.names == self.begins for relation in schema.relations)


def check_span(document: Document, schema: Schema, states: list[str], span: RunSpan) -> None:
    """Check that the names of a `[run]` are those of the procedure.

    Raises:
        BadInput: With file, line and reason.
    """
    if not span.is_told_by(schema):
        valid = ", ".join(str(Triplet(*relation.names)) for relation in schema.relations)
        raise document.error(f"{Triplet(*span.begins)} is no relation; there are: {valid}", "run.begins")
    for key, state in (("ends_in", span.ends_in), ("contact_in", span.contact_in)):
        check_known(document, "state", state, states, f"run.{key}")
