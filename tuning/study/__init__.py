"""A study as data: the TOML file and its tables. Nothing here imports jax."""
