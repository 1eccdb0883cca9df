"""Scenes whose truth comes from a renderer that is not ours: Mitsuba 3."""
