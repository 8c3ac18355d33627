#!/usr/bin/env python3
"""A picture (SVG) of the dashboard of `tendril status --watch`, 80x24, beside a running `tendril sim` whose robot it bends.
Usage: dashboard_picture.py PICTURE.svg; for tools/draw_pictures. Knows the package only."""
import asyncio
import pathlib
import re
import sys

import tendril
from tendril.dashboard.app import Dashboard
from tendril.dashboard.guard import Guard
from tendril.dashboard.jog import Jog
from tendril.dashboard.operator import Operator


async def draw(picture, client, guard):
    app = Dashboard(Operator(client, guard, Jog()))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause(1.5)
        await pilot.press("a")
        await pilot.pause(1.5)
        await pilot.press("j")
        for _ in range(60):
            await pilot.press("right")
            await pilot.pause(0.03)
        # Without the font that it would fetch from elsewhere.
        picture.write_text(re.sub(r"@font-face\s*{.*?}", "", app.export_screenshot(), flags=re.S))
    app.operator.leave()


def main():
    if len(sys.argv) != 2 or not sys.argv[1].endswith(".svg"):
        sys.exit(__doc__)
    with tendril.Client() as client:
        guard = Guard(None, "TENDRIL")
        guard.start()
        asyncio.run(draw(pathlib.Path(sys.argv[1]).resolve(), client, guard))


if __name__ == "__main__":
    main()
