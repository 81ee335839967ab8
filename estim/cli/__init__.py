"""The command line: the only package that prints, or asks for signals.

Read `commands` first.  Nothing imports it."""
