"""The figures an issue asks for, in full: `make acceptance [NAME]` writes out/acceptance/NAME.json."""
