"""Deployable forms of a tuned configuration, each with a manifest and a check that was run."""

from tuning.exports.export import Exported, export_config

__all__ = ["Exported", "export_config"]
