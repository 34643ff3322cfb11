"""Logs of real robots: read, mapped to signals, judged, estimated and tuned on."""
