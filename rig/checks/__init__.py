"""What must hold of a rig before anybody prints it: one module a subject; each returns faults."""
