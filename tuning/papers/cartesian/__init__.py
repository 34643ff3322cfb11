"""Petit, Albu-Schäffer: Cartesian impedance control for a variable stiffness robot arm."""
