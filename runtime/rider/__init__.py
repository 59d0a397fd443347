"""The rider of a running chair: inputs, level of help and guard, habits after a yes, and sentences about the path."""
