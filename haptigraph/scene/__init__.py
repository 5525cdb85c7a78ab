"""From places to relations: the measures and the builder of scene graphs."""
