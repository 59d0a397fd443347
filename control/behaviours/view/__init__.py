"""The view of today's sensors: what is known round the chair, and the orientations that its outline can take."""
