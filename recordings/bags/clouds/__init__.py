"""Point clouds as scans: `cloud_decoding` reads one message, `cloud_units` and `cloud_scans` a whole topic."""
