"""TOML to an immutable model in SI, with units, validation and messages."""
