"""What every command shares: options, output and progress."""
