"""The vibrating glove, and its relatives: layouts of motors, messages, the bridge, and the firmware as a program.

Begin with `layouts.py` (motors on the body), `messages.py` (the cable), `bridge.py` (the session), `program.py` (the shipped
C on this computer, which reports the motors' levels every millisecond).
"""
