"""Bricks over HTTP: one, many, those that a view needs, and tables of what is known of each."""
