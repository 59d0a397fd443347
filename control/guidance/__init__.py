"""Step guidance for a rider who drives: begin with `guidance.py`. Nothing in this room moves the chair."""
