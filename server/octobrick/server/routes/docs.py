"""A page that lists the routes: plain HTML made from the OpenAPI description, no scripts."""

from __future__ import annotations

from html import escape
from typing import Any

from fastapi import APIRouter, Request
from starlette.responses import HTMLResponse

router = APIRouter(include_in_schema=False)

_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 56rem; margin: 2rem auto; padding: 0 1rem }
code { font-family: ui-monospace, monospace; font-size: .9em }
h2 { margin-top: 2.5rem; border-top: 1px solid #ccc; padding-top: 1rem }
table { border-collapse: collapse; width: 100% }
td, th { text-align: left; vertical-align: top; padding: .2rem .8rem .2rem 0 }
"""


@router.get("/docs")
async def docs(request: Request) -> HTMLResponse:
    """The routes, for people; programs read /openapi.json."""
    page = routes_page(request.app.openapi())
    return HTMLResponse(page, headers={"content-security-policy": _POLICY})


def routes_page(openapi: dict[str, Any]) -> str:
    """An OpenAPI description as one HTML page."""
    info = openapi["info"]
    sections = [
        _section(method, path, operation)
        for path, operations in openapi["paths"].items()
        for method, operation in operations.items()
    ]
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{escape(info["title"])}'
        f"</title><style>{_STYLE}</style><h1>{escape(info['title'])} {escape(info['version'])}</h1>"
        f"<p>{escape(info['description'])}</p>"
        '<p>For programs: <a href="openapi.json">openapi.json</a></p>' + "".join(sections)
    )


def _section(method: str, path: str, operation: dict[str, Any]) -> str:
    text = operation.get("description", operation["summary"])
    parameters = [_parameter_row(parameter) for parameter in operation.get("parameters", [])]
    responses = [
        f"<tr><td><code>{status}</code><td>{escape(response['description'])}"
        for status, response in operation["responses"].items()
    ]
    return (
        f"<h2><code>{method.upper()} {escape(path)}</code></h2><p>{escape(text)}</p>"
        + _table("<tr><th>parameter<th>meaning<th>example", parameters)
        + _table("<tr><th>status<th>meaning", responses)
    )


def _table(head: str, rows: list[str]) -> str:
    return f"<table>{head}{''.join(rows)}</table>" if rows else ""


def _parameter_row(parameter: dict[str, Any]) -> str:
    schema = parameter["schema"]
    example = next(iter(parameter.get("examples") or schema.get("examples") or [""]))
    note = f" (default {schema['default']})" if "default" in schema else ""
    return (
        f"<tr><td><code>{escape(parameter['name'])}</code>"
        f"<td>{escape(parameter.get('description', ''))}{escape(note)}"
        f"<td><code>{escape(str(example))}</code>"
    )
