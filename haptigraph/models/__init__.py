"""Networks that ship with haptigraph: ONNX files, the TOML file that describes them, and one of numbers."""
