"""C99 from a step program: expressions, lowering, statements, files."""
