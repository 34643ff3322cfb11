"""The checks that travel with an export: each is copied beside its artefact and needs nothing of the lab."""
