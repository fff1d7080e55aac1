"""ONNX policies: read within a checked subset of operators, and exported."""
