"""Simulated riders who are guided step by step, and their scores."""
