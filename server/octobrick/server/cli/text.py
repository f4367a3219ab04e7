"""Numbers as text for people, in SI units."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

_FILE_COLUMNS = 120  # where nobody says how wide: enough for any table, so that nothing is cut


def format_nbytes(nbytes: float) -> str:
    """A size, such as ``14.2 MB`` (10⁶ bytes)."""
    if nbytes < 1000:
        return f"{nbytes:.0f} B"
    power = min(int(math.log10(nbytes * 1.00005) / 3), 4)  # 999.96 kB is 1.0 MB
    return f"{nbytes / 1000**power:.1f} {('kB', 'MB', 'GB', 'TB')[power - 1]}"


def format_seconds(seconds: float) -> str:
    """A time, such as ``4.2 s`` or ``1:07:30``."""
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


def format_shape(shape: Sequence[float]) -> str:
    """Numbers along the axes, such as ``256×256×108``."""
    return "×".join(f"{n:g}" for n in shape)


def format_ratio(nbytes: int, stored_nbytes: int) -> str:
    """How many times smaller something became; a dash where nothing is stored at all."""
    return f"{nbytes / stored_nbytes:.1f}" if stored_nbytes else "–"


def format_psnr(psnr_db: float | None) -> str:
    """A peak signal-to-noise ratio; None means that nothing was lost."""
    return "exact" if psnr_db is None else f"{psnr_db:.1f} dB"


def print_table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table on stdout, a rule under its head, numbers to the right."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for column in columns:
        table.add_column(column, justify="right", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    console = Console()
    if not console.is_terminal:
        console.width = _FILE_COLUMNS
    console.print(table)
