"""The verb `labanmesh camera` with its sub-verbs: what a person does with a camera before it is an observer's."""

from common.command_options import sub_verbs
from observer.calibration.commands import calibrate
from observer.preview.commands import look
from observer.recording.commands import place, record

camera = sub_verbs(
    """Look through a camera, calibrate cameras, find where a person stands, record motion with them.

    Example: labanmesh camera look 0
    """
)
for sub_verb in (look, calibrate, place, record):
    camera.command()(sub_verb)
