"""What stands on disk: read with every mistake named, and written whole."""
