"""Where script/test found that script/check fails, pytest's last lines say so."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from _pytest.terminal import TerminalReporter


def pytest_terminal_summary(terminalreporter: TerminalReporter) -> None:
    if os.environ.get("OCTOBRICK_CHECK_STATUS", "0") != "0":
        terminalreporter.section("script/check failed: see above the tests", red=True)
