"""The tables of a study, one class a module of vsajax."""
