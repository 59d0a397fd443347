"""The command line: one file per group of commands, each a shell over one function, imported late."""
