"""Python imports this by itself when it starts with this folder on its path."""

from mutant_hook import install_as_told

install_as_told()
