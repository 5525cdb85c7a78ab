"""Show a run of haptigraph in 3D Slicer: the needle and the globe in 3D, the surgical state as text.

Start a run with the bridge, live or from a recording:

    haptigraph run camera:0 --registration eye.toml --bridge openigtlink
    haptigraph run run.mcap --bridge openigtlink

and Slicer, with the extension SlicerOpenIGTLink, with this script:

    Slicer --python-script show_run.py
    Slicer --python-script show_run.py --host 192.168.0.7 --port 18944 --globe-mm 24

The scene is the eye frame: origin at the centre of the globe, R to the right, A up in the image, S out of
it. Research software, not a medical device.
"""

import argparse
import sys

TRANSFORM, STATE = "NeedleToEye", "SurgicalState"  # devices of the bridge
WITHOUT_TIP = ("unknown", "tip_not_visible")  # states in which the transform is old
NEEDLE_MM, POINT_MM, DIAMETER_MM = 30.0, 1.0, 0.5
UPDATE_MS = 100
NEEDLE_RGB, GLOBE_RGB = (0.9, 0.9, 0.95), (0.95, 0.6, 0.4)


def parse_arguments(arguments):
    """Return the options; Slicer passes its own arguments on, too."""
    parser = argparse.ArgumentParser(description="Show a run of haptigraph in 3D Slicer.")
    parser.add_argument("--host", default="localhost", help="where haptigraph runs")
    parser.add_argument("--port", type=int, default=18944, help="of the bridge openigtlink")
    parser.add_argument("--globe-mm", type=float, default=24.0, help="inner diameter; 0: no globe (B-scans)")
    return parser.parse_known_args(arguments)[0]


def what_to_show(state, is_connected, has_transform):
    """Return the text, and whether the needle is where the transform says.

    Args:
        state: The surgical state; None if none was received yet.
        is_connected: Whether the connection to haptigraph stands.
        has_transform: Whether a pose of the needle was received.
    """
    if not is_connected:
        return "not connected to haptigraph", False
    if state is None:
        return "connected; nothing received yet", False
    return state.replace("_", " "), has_transform and state not in WITHOUT_TIP


def needle_model():
    """Return a needle as vtkPolyData: its tip in the origin, its shaft along -z; mm."""
    import vtk

    shaft = vtk.vtkLineSource()
    shaft.SetPoint1(0.0, 0.0, -POINT_MM)
    shaft.SetPoint2(0.0, 0.0, -NEEDLE_MM)
    tube = vtk.vtkTubeFilter()
    tube.SetInputConnection(shaft.GetOutputPort())
    tube.SetRadius(DIAMETER_MM / 2)
    tube.SetNumberOfSides(24)
    tube.CappingOn()
    point = vtk.vtkConeSource()
    point.SetDirection(0.0, 0.0, 1.0)
    point.SetCenter(0.0, 0.0, -POINT_MM / 2)
    point.SetHeight(POINT_MM)
    point.SetRadius(DIAMETER_MM / 2)
    point.SetResolution(24)
    both = vtk.vtkAppendPolyData()
    both.AddInputConnection(tube.GetOutputPort())
    both.AddInputConnection(point.GetOutputPort())
    both.Update()
    return both.GetOutput()


def globe_model(diameter_mm):
    """Return the globe as vtkPolyData, about the origin; mm."""
    import vtk

    sphere = vtk.vtkSphereSource()
    sphere.SetRadius(diameter_mm / 2)
    sphere.SetThetaResolution(64)
    sphere.SetPhiResolution(64)
    sphere.Update()
    return sphere.GetOutput()


class Scene:
    """The nodes in Slicer, updated by a timer."""

    def __init__(self, options):
        import qt
        import slicer

        self.connector = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLIGTLConnectorNode", "haptigraph")
        self.connector.SetTypeClient(options.host, options.port)
        self.connector.Start()
        self.needle = self.add_model("Needle", needle_model(), NEEDLE_RGB, 1.0)
        if options.globe_mm > 0:
            self.add_model("Globe", globe_model(options.globe_mm), GLOBE_RGB, 0.2)
        slicer.app.layoutManager().setLayout(slicer.vtkMRMLLayoutNode.SlicerLayoutOneUp3DView)
        self.view = slicer.app.layoutManager().threeDWidget(0).threeDView()
        self.view.resetFocalPoint()
        self.shown = None
        self.timer = qt.QTimer()
        self.timer.timeout.connect(self.update)
        self.timer.start(UPDATE_MS)

    def add_model(self, name, poly_data, color, opacity):
        import slicer

        model = slicer.modules.models.logic().AddModel(poly_data)
        model.SetName(name)
        model.GetDisplayNode().SetColor(*color)
        model.GetDisplayNode().SetOpacity(opacity)
        return model

    def update(self):
        """Put the needle under the transform once it has come, and show the state."""
        import slicer
        import vtk

        transform = slicer.mrmlScene.GetFirstNode(TRANSFORM, "vtkMRMLLinearTransformNode")
        if transform is not None and self.needle.GetTransformNodeID() != transform.GetID():
            self.needle.SetAndObserveTransformNodeID(transform.GetID())
        text = slicer.mrmlScene.GetFirstNode(STATE, "vtkMRMLTextNode")
        state = text.GetText() if text is not None else None
        is_connected = self.connector.GetState() == self.connector.StateConnected
        shown = what_to_show(state, is_connected, transform is not None)
        if shown != self.shown:
            self.shown = shown
            self.needle.GetDisplayNode().SetVisibility(shown[1])
            self.view.cornerAnnotation().SetText(vtk.vtkCornerAnnotation.UpperLeft, shown[0])
            self.view.forceRender()


if __name__ == "__main__":
    scene = Scene(parse_arguments(sys.argv[1:]))  # the name keeps the timer alive
