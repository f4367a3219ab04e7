"""The routes, one file per noun; none holds logic that could stand without HTTP."""
