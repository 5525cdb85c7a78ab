"""The part of a run over which its measures are taken; a procedure defines it, by default as in the paper."""

from msgspec import Struct

from haptigraph.graph import Names, Schema
from haptigraph.inference.checks import check_name, check_relations
from haptigraph.toml_document import Document

__all__ = ["RunSpan", "check_span"]


class RunSpan(Struct, frozen=True, forbid_unknown_fields=True):
    """A run begins with the first appearance of an edge and ends in a state (paper, section III)."""

    begins: Names = ("needle_tip", "inside", "eye_globe")
    """The edge whose first appearance begins the run."""
    ends_in: str = "target_hit"
    """The state whose first appearance ends the run."""
    contact_in: str = "retinal_contact"
    """The state that counts as an unintended contact."""

    def is_defined_in(self, schema: Schema) -> bool:
        """Return whether a schema has the edge that begins a run; without it, no run begins."""
        return any(relation.names == self.begins for relation in schema.relations)


def check_span(document: Document, schema: Schema, states: list[str], span: RunSpan) -> None:
    """Check that `[run]` refers to edges and states of the procedure.

    Raises:
        BadInput: With file, line and reason.
    """
    check_relations(document, schema, [span.begins], "run.begins")
    for key, state in (("ends_in", span.ends_in), ("contact_in", span.contact_in)):
        check_name(document, "state", state, states, f"run.{key}")
