"""`python -m vsajax`: the command that is installed with the library, which itself knows nothing of it."""

from importlib.metadata import entry_points

(command,) = entry_points(group="console_scripts", name="vsajax")
command.load()()
