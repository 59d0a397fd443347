"""The page's building mode: `session.py` holds one building that is being edited, `server.py` serves it to pages."""
