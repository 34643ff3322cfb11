"""Deployable forms of a tuned configuration, each with a manifest, a golden recording and a check that was run."""
