"""Polygon meshes that show a volume as their solid texture (Bajaj, Ihm, Park 2001, section 4.3)."""
