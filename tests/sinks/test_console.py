import io

from helpers import MS, make_step

from haptigraph.messages import Capture, Fault
from haptigraph.sinks.console import ConsoleSink


def test_changes_and_new_faults_are_told_once():
    stream = io.StringIO()
    sink = ConsoleSink(stream)
    fault = Fault("source", "camera:0 is gone")
    for ms, state, faults in ((0, "a", ()), (33, "a", ()), (66, "b", (fault,)), (99, "b", (fault,))):
        sink.write(Capture(0, ms * MS, None), make_step(stamp_ns=ms * MS, state=state, faults=faults))
    sink.close()
    assert stream.getvalue().splitlines() == [
        "   0.00 s  a                                  because",
        "   0.07 s  ! source: camera:0 is gone",
        "   0.07 s  b                                  because",
    ]
    assert sink.take_faults() == ()
