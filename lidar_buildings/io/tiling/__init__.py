"""Surveys cut into tiles."""
