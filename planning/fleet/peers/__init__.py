"""Chairs that keep one order over a network without a centre: messages, peers, and the warden that they choose.

Begin with `peer.py`: one step of a chair's peer. `election.py` chooses the warden, `networked_warden.py` keeps the order of a
district from the chairs' own words, and `messages.py` is the language between them. None of it knows a transport or a clock.
"""
