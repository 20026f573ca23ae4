"""Reads series in ParaView: `python3 paraview_series.py FOLDER PICTURE SERIES...`, with the Python that has ParaView.

Prints, as JSON, the times of each series and, at its last time, the counts of its points and cells and the range of each
component of its arrays. PICTURE shows the first series then, cut in half and coloured by von Mises stress.
"""

import json
import sys
from pathlib import Path

from paraview import simple


def ranges(arrays) -> dict[str, list[list[float]]]:
    """The least and the greatest value of each component of each array."""
    return {
        array.GetName(): [list(array.GetRange(k)) for k in range(array.GetNumberOfComponents())]
        for array in (arrays.GetArray(k) for k in range(arrays.GetNumberOfArrays()))
    }


folder, picture, *series = sys.argv[1:]
found = {}
for name in series:
    reader = simple.OpenDataFile(str(Path(folder) / f"{name}.pvd"))
    times = list(reader.TimestepValues)
    reader.UpdatePipeline(time=times[-1])
    information = reader.GetDataInformation()
    found[name] = {
        "times": times,
        "points": information.GetNumberOfPoints(),
        "cells": information.GetNumberOfCells(),
        "point_data": ranges(reader.PointData),
        "cell_data": ranges(reader.CellData),
    }
    if name == series[0]:
        cut = simple.Clip(Input=reader, ClipType="Plane")
        cut.ClipType.Normal = [0.0, 0.0, 1.0]
        cut.ClipType.Origin = [0.0, 0.0, 0.0]
        view = simple.CreateRenderView(ViewSize=[300, 300], Background=[1.0, 1.0, 1.0], UseColorPaletteForBackground=0)
        view.OrientationAxesVisibility = 0
        view.ViewTime = times[-1]
        shown = simple.Show(cut, view)
        simple.ColorBy(shown, ("CELLS", "von_mises_stress"))
        colours = simple.GetColorTransferFunction("von_mises_stress")
        colours.ApplyPreset("Grayscale", True)
        shown.RescaleTransferFunctionToDataRange(False)
        shown.SetScalarBarVisibility(view, False)
        shown.Ambient, shown.Diffuse = 1.0, 0.0
        view.CameraPosition, view.CameraFocalPoint = [0.0, -0.015, 0.2], [0.0, -0.015, 0.0]
        view.CameraViewUp = [0.0, 1.0, 0.0]
        simple.SaveScreenshot(picture, view)
print(json.dumps(found))
