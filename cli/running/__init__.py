"""Commands that start a chair's nodes, and commands for a chair that runs."""
