"""The paper's node network and Plan-FWPP. Begin with `plan_fwpp.py` for its labels and `network.py` for its messages."""
