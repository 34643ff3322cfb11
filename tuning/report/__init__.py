"""What a finished run shows, as one HTML file: pictures first, then tables, then provenance."""
