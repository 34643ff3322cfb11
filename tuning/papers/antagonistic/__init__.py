"""Ménard, Grioli, Bicchi: agonist-antagonist joint and the algebraic observer."""
