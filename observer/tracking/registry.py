"""All trackers by name: the content that each reads, and how it is built from an observer's section."""

from collections.abc import Mapping
from functools import partial

from common.errors import BadInput, LabanmeshError
from common.plugins import plugin, plugins
from common.text import nearest
from common.tracker_choice import AUTO, Content, TrackerChoice
from observer.foreign import ForeignPeople, ForeignTracker
from observer.geometry.views import facing
from observer.motion.projected import ProjectedPeople, ProjectedTracker
from observer.tracking.tracker_kind import TrackerKind, TrackerSettings
from observer.tracks import BODY_PARTS, WHOLE_BODY, Tracker


def _projected(settings: TrackerSettings) -> Tracker:
    if settings.most > 1:
        return ProjectedPeople(settings.view, settings.recorded, settings.most)
    # The wanted parts must have been recorded; the others cost nothing, and an observer that is taught records them.
    others = tuple(part for part in settings.recorded if part not in settings.wanted)
    return ProjectedTracker(settings.view, settings.recorded, (*settings.wanted, *others))


def _camshift(settings: TrackerSettings) -> Tracker:
    # Imported on use: OpenCV takes 0.2 s, and projected motion does not need it.
    from observer.tracking.camshift import CamshiftTracker
    from observer.tracking.skin import SkinHistogram

    section = settings.section
    skin = SkinHistogram.load(settings.place(section.skin)) if section.skin else None
    return CamshiftTracker(skin, section.face, facing(settings.view))


def _mediapipe(settings: TrackerSettings) -> Tracker:
    from observer.tracking.mediapipe_pose import MediapipeTracker, open_people
    from observer.tracking.people import FollowRule
    from observer.tracking.several_poses import SeveralPoses

    section = settings.section
    path = str(settings.place(section.pose_model)) if section.pose_model else None
    if settings.most > 1:
        return SeveralPoses(partial(open_people, path, settings.smooth), "mediapipe", settings.most, section.hand)
    rule = FollowRule(section.follow, section.follow_near)
    return MediapipeTracker(path, section.hand, WHOLE_BODY, rule, settings.smooth)


def _foreign(settings: TrackerSettings) -> Tracker:
    if settings.most > 1:
        return ForeignPeople(settings.recorded, settings.most)
    return ForeignTracker(settings.recorded)


TRACKERS: Mapping[str, TrackerKind] = {
    kind.name: kind
    for kind in (
        TrackerKind("projected", "positions", _projected),
        TrackerKind("camshift", "pictures", _camshift, BODY_PARTS),
        TrackerKind("mediapipe", "pictures", _mediapipe, WHOLE_BODY),
        TrackerKind("foreign", "tracks", _foreign),
    )
}


def tracker_named(name: str, key: str, content: Content) -> TrackerKind:
    """The tracker of that name, ours or of an installed package. key: the option or scene-file key of the name.

    Raises BadInput for an unknown name, and for a tracker that cannot read this content.
    """
    kind = TRACKERS.get(name) or plugin("trackers", name)
    if not isinstance(kind, TrackerKind):
        raise BadInput(f"{key} = {name!r}: unknown tracker; {nearest(name, [AUTO, *TRACKERS, *plugins('trackers')])}")
    # The virtual camera turns positions into pictures; no other content can be converted.
    if kind.reads != content and (content, kind.reads) != ("positions", "pictures"):
        suitable = ", ".join(k.name for k in TRACKERS.values() if k.reads == content)
        raise BadInput(f"{key} = {name!r}: reads {kind.reads}, but the source provides {content}; use {suitable}")
    return kind


def built_tracker(choice: TrackerChoice, kind: TrackerKind, settings: TrackerSettings) -> tuple[Tracker, TrackerChoice]:
    """The tracker of `kind`, or if it does not start the choice's fallback; and the choice as it came out.

    Raises BadInput and LabanmeshError, as the tracker does, where there is no fallback.
    """
    try:
        return kind.build(settings), choice
    except LabanmeshError as error:
        if not choice.fallback:
            raise
        fault = str(error)
    return TRACKERS[choice.fallback].build(settings), TrackerChoice(choice.fallback, fault, lacks=fault)
