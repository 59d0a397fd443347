"""Commands and files of a chair with the faults that people met."""
