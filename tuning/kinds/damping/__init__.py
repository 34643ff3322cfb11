"""Damping studies: a link is hit, and stiffness or motor bring it to rest."""
