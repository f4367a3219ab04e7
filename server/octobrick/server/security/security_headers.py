"""Headers that keep browsers from doing more with an answer than was meant.

``Strict-Transport-Security`` is not among them: it belongs to whoever ends TLS, the proxy.
"""

from __future__ import annotations

RawHeaders = list[tuple[bytes, bytes]]

# Of an answer that has none of its own: it may load nothing, and be framed by nobody.
DEFAULT_POLICY = (b"content-security-policy", b"default-src 'none'; frame-ancestors 'none'")


def security_headers(*, other_origins: bool) -> RawHeaders:
    """The headers of every answer.

    Args:
        other_origins: pages of other origins may read answers (``cors_origins`` is set). Then
            they may also embed them without asking, for instance pictures in ``<img>``.
    """
    policy = b"cross-origin" if other_origins else b"same-origin"
    return [
        (b"x-content-type-options", b"nosniff"),
        (b"x-frame-options", b"DENY"),
        # A signed address is a secret: no link on a page of ours tells it to others.
        (b"referrer-policy", b"no-referrer"),
        (b"cross-origin-resource-policy", policy),
    ]
