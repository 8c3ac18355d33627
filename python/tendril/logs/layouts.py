"""Layouts that open beside an exported file or a live bridge: the robot, its tip, tensions, mode and log lines."""

from __future__ import annotations

import json
import pathlib
from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree

from .encode import Source

AXES = ("x", "y", "z")
COLOURS = ("#1f77b4", "#d62728", "#2ca02c", "#ff7f0e", "#9467bd", "#17becf", "#8c564b", "#e377c2")
Curve = tuple[str, int, str]  # field, index in it, label


def tip_curves(source: Source) -> list[Curve]:
    reference = "tip_desired_W_m" if source.topic == "state" else "reference_tip_W_m"
    both = ((reference, "reference"), ("tip_estimate_W_m", "estimate"))
    return [(field, i, f"{name} {axis}") for i, axis in enumerate(AXES) for field, name in both]


def tendon_curves(source: Source, field: str, name: str) -> list[Curve]:
    return [(field, i, f"{name} {i + 1}") for i in range(source.tendons)]


def plots(source: Source) -> dict[str, list[Curve]]:
    """Title and curves of each plot; fields of which states and cycles have the same names."""
    return {
        "Tip [m]": tip_curves(source),
        "Bending [rad]": [("bending_estimate_rad", i, f"estimate {i + 1}") for i in range(source.bendings)],
        "Tensions, measured [N]": tendon_curves(source, "tension_measured_N", "tendon"),
        "Tensions, desired at the motor [N]": tendon_curves(source, "tension_desired_motor_N", "tendon"),
    }


def _foxglove_plot(source: Source, title: str, curves: Sequence[Curve]) -> dict[str, Any]:
    topic = f"/{source.prefix}/{source.topic}"
    paths = [
        {
            "value": f"{topic}.{field}[{i}]",
            "label": label,
            "enabled": True,
            "timestampMethod": "receiveTime",
            "color": COLOURS[n % len(COLOURS)],
        }
        for n, (field, i, label) in enumerate(curves)
    ]
    return {
        "title": title,
        "paths": paths,
        "xAxisVal": "timestamp",
        "showLegend": True,
        "legendDisplay": "floating",
        "isSynced": True,
    }


def _foxglove_robot(prefix: str) -> dict[str, Any]:
    """A 3-D panel that looks at the robot's base from as far as a robot of some decimetres needs."""
    base = f"{prefix}/F_0"
    return {
        "cameraState": {
            "distance": 0.3,
            "perspective": True,
            "phi": 70,
            "thetaOffset": 45,
            "target": [0, 0, 0],
            "targetOffset": [0, 0, 0.04],
            "targetOrientation": [0, 0, 0, 1],
            "fovy": 45,
            "near": 0.001,
            "far": 100,
        },
        "followMode": "follow-none",
        "followTf": base,
        "scene": {"transforms": {"axisScale": 0.02, "labelSize": 0.005}},
        "topics": {f"/{prefix}/scene": {"visible": True}, f"/{prefix}/frames": {"visible": True}},
        "layers": {
            "grid": {
                "layerId": "foxglove.Grid",
                "instanceId": "grid",
                "label": "Grid",
                "visible": True,
                "frameId": base,
                "size": 0.4,
                "divisions": 8,
                "lineWidth": 1,
                "color": "#248eff55",
                "position": [0, 0, 0],
                "rotation": [0, 0, 0],
            }
        },
    }


def foxglove(source: Source) -> str:
    """For Foxglove's "Import from file": the robot in 3-D, plots, the mode as a bar, the log lines."""
    topic = f"/{source.prefix}/{source.topic}"
    mode = f"{topic}.mode_text" if source.topic == "state" else f"{topic}.mode"
    panels: dict[str, dict[str, Any]] = {
        "3D!robot": _foxglove_robot(source.prefix),
        "StateTransitions!mode": {
            "paths": [{"value": mode, "timestampMethod": "receiveTime"}],
            "isSynced": True,
        },
        "RosOut!lines": {"topicToRender": f"/{source.prefix}/log", "searchTerms": [], "minLogLevel": 1},
    }
    rows: Any = None
    for n, (title, curves) in reversed(list(enumerate(plots(source).items()))):
        name = f"Plot!{n}"
        panels[name] = _foxglove_plot(source, title, curves)
        rows = _split("column", name, rows, 100 / (len(plots(source)) - n)) if rows else name
    left = _split("column", "3D!robot", _split("column", "StateTransitions!mode", "RosOut!lines", 30), 65)
    layout = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": _split("row", left, rows, 45),
    }
    return json.dumps(layout, indent=1) + "\n"


def _split(direction: str, first: Any, second: Any, share: float) -> dict[str, Any]:
    return {"direction": direction, "first": first, "second": second, "splitPercentage": share}


def plotjuggler(sources: Sequence[Source]) -> str:
    """For `plotjuggler --layout`: a tab a robot with its plots."""
    root = ElementTree.Element("root")
    tabs = ElementTree.SubElement(root, "tabbed_widget", {"name": "Main Window", "parent": "main_window"})
    for source in sources:
        tab = ElementTree.SubElement(tabs, "Tab", tab_name=source.prefix, containers="1")
        charts = plots(source)
        sizes = ";".join(f"{1 / len(charts):g}" for _ in charts)
        container = ElementTree.SubElement(tab, "Container")
        rows = ElementTree.SubElement(
            container, "DockSplitter", orientation="-", sizes=sizes, count=str(len(charts))
        )
        for title, curves in charts.items():
            area = ElementTree.SubElement(rows, "DockArea", name=title)
            plot = ElementTree.SubElement(
                area, "plot", mode="TimeSeries", style="Lines", flip_x="false", flip_y="false"
            )
            ElementTree.SubElement(plot, "limitY")
            for n, (field, i, _) in enumerate(curves):
                name = f"/{source.prefix}/{source.topic}/{field}[{i}]"
                ElementTree.SubElement(plot, "curve", name=name, color=COLOURS[n % len(COLOURS)])
    ElementTree.SubElement(tabs, "currentTabIndex", index="0")
    ElementTree.SubElement(root, "use_relative_time_offset", enabled="1")
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def paths_beside(path: pathlib.Path) -> tuple[pathlib.Path, pathlib.Path]:
    """Of the layouts for Foxglove and for PlotJuggler of a file."""
    return path.with_suffix(".foxglove.json"), path.with_suffix(".plotjuggler.xml")


def beside(path: pathlib.Path, sources: Sequence[Source]) -> dict[pathlib.Path, str]:
    """The layouts of a file, by their paths; none where no robot moves in it. Foxglove's shows the first robot."""
    if not sources:
        return {}
    of_foxglove, of_plotjuggler = paths_beside(path)
    return {of_foxglove: foxglove(sources[0]), of_plotjuggler: plotjuggler(sources)}
