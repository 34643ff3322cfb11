"""Runs on disk and on machines: folders, executors and workers."""
