"""The parts of the nodes: the work of one subject, with its topics, services and actions, for the node that owns it."""
