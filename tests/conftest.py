from __future__ import annotations

import os
from typing import TYPE_CHECKING

from hypothesis import HealthCheck, settings

if TYPE_CHECKING:
    from _pytest.terminal import TerminalReporter

# No test measures time: a busy machine must not fail one that is right.
settings.register_profile(
    "octobrick", deadline=None, suppress_health_check=[HealthCheck.too_slow], print_blob=True
)
settings.load_profile("octobrick")


def pytest_terminal_summary(terminalreporter: TerminalReporter) -> None:
    """Where script/test found that script/check fails, the last lines say so."""
    if os.environ.get("OCTOBRICK_CHECK_STATUS", "0") != "0":
        terminalreporter.section("script/check failed: see above the tests", red=True)
