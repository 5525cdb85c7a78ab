"""Networks that ship with haptigraph: ONNX files, each with the TOML that says what its classes are."""
