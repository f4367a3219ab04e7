"""The form of log lines: text for people, or one JSON object a line for programs."""

from __future__ import annotations

import json
import logging
import time
from typing import Any, Literal

from octobrick.server.operations.request_id import current_request_id

LogFormat = Literal["text", "json"]


class TextLines(logging.Formatter):
    """``2026-01-31T12:00:00.123Z INFO octobrick.access: GET /healthz status=200 … id=…``."""

    def format(self, record: logging.LogRecord) -> str:
        """One line, and below it a traceback where there is one."""
        words = [f"{_time_of(record)} {record.levelname} {record.name}: {record.getMessage()}"]
        shown = {"method", "path"}  # they are the message
        fields: dict[str, object] = getattr(record, "fields", {})
        words += [f"{name}={value}" for name, value in fields.items() if name not in shown]
        request_id = current_request_id.get()
        if request_id:
            words.append(f"id={request_id}")
        line = " ".join(words)
        return f"{line}\n{self.formatException(record.exc_info)}" if record.exc_info else line


class JsonLines(logging.Formatter):
    """``{"time": …, "level": …, "logger": …, "message": …, "request_id": …, …fields}``."""

    def format(self, record: logging.LogRecord) -> str:
        """One line, always: a traceback is a field."""
        line: dict[str, Any] = {
            "time": _time_of(record),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        request_id = current_request_id.get()
        if request_id:
            line["request_id"] = request_id
        line |= getattr(record, "fields", {})
        if record.exc_info:
            line["traceback"] = self.formatException(record.exc_info)
        return json.dumps(line, ensure_ascii=True, default=str)


def log_config(level: str, log_format: LogFormat) -> dict[str, Any]:
    """What ``logging.config.dictConfig`` takes: everything to stderr, in one form.

    stdout has the server's address and nothing else.
    """
    lines = JsonLines if log_format == "json" else TextLines
    return {
        "version": 1,
        "disable_existing_loggers": False,
        "formatters": {"lines": {"()": lines}},
        "handlers": {"stderr": {"class": "logging.StreamHandler", "formatter": "lines"}},
        "root": {"level": "WARNING", "handlers": ["stderr"]},
        "loggers": {
            "octobrick": {"level": level.upper()},
            "uvicorn": {"level": level.upper()},
            # Whether a request has a line is a setting of its own, not a level.
            "octobrick.access": {"level": "INFO"},
        },
    }


def _time_of(record: logging.LogRecord) -> str:
    seconds = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(record.created))
    return f"{seconds}.{int(record.msecs):03d}Z"
