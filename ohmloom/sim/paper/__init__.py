"""The paper's experiments, and what of them reproduces."""
