"""Networks that ship with haptigraph: ONNX files, and the TOML file that describes them."""
