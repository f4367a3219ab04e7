from __future__ import annotations

from hypothesis import HealthCheck, settings

# No test measures time: a busy machine must not fail one that is right.
settings.register_profile(
    "octobrick", deadline=None, suppress_health_check=[HealthCheck.too_slow], print_blob=True
)
settings.load_profile("octobrick")
