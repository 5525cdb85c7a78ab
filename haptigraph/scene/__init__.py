"""The measures of a scene and the builder of scene graphs: from positions to relations."""
