"""Networks that ship with haptigraph: ONNX files, each with the TOML file that describes it."""
