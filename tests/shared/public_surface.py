"""The public surface, written down: every verb with its options, and the schemas of the messages and the scene file.

`make surface` rewrites docs/reference/surface.txt and docs/reference/schema. A test compares them with the code: no
change of the surface goes unnoticed.
"""

import json
from typing import get_args

import typer
from doc_pages import ROOT

import labanmesh
from common import messages
from common.config import Scene
from common.fall_messages import FallMessage, PostureMessage
from common.picture_message import PictureMessage

SURFACE = ROOT / "docs" / "reference" / "surface.txt"
SCHEMAS = ROOT / "docs" / "reference" / "schema"
REWRITE = "if that is meant: make surface, and a line in CHANGELOG.md"
MESSAGES = {
    kind: getattr(messages, f"{kind.capitalize()}Message")
    for kind in ("posterior", "judgement", "verdict", "status", "vocabulary")
} | {"picture": PictureMessage, "posture": PostureMessage, "fall": FallMessage}
MODELS = {**MESSAGES, "scene": Scene}
"""What has a schema, by the name of its file."""


def surface():
    """The command line as text: a line for each verb and, below it, one for each argument and option."""
    forms = [(verb, ()) for verb in labanmesh.VERBS] + [(verb, (option,)) for verb, option in labanmesh.OTHER_FORMS]
    lines = []
    for verb, words in forms:
        command = typer.main.get_command(labanmesh.app_of(verb, words))
        for name, each in getattr(command, "commands", {"": command}).items():
            lines += [" ".join(["labanmesh", verb, *words, *([name] if name else [])])]
            lines += [f"    {parameter_line(parameter)}" for parameter in each.params]
    lines += [f"labanmesh {old} = labanmesh {new}" for old, new in labanmesh.RENAMED.items()]
    return "\n".join(lines) + "\n"


def parameter_line(parameter):
    """`--frames INT 1..1000000000 = 30`: names, type, bounds, default; an argument in capital letters."""
    of_argument = parameter.param_type_name == "argument"
    words = [parameter.name.upper() if of_argument else ", ".join([*parameter.opts, *parameter.secondary_opts])]
    if not getattr(parameter, "is_flag", False):
        annotation = parameter.type_descriptor.annotation
        (of_one,) = get_args(annotation) or (annotation,)
        words.append(of_one.__name__.upper() + ("" if of_one is annotation else "..."))
        least, most = getattr(parameter, "min", None), getattr(parameter, "max", None)
        words += [f"{least}..{most}"] if (least, most) != (None, None) else []
        words += ["required"] if parameter.required else []
    if parameter.default not in (None, False, ""):
        words.append(f"= {json.dumps(parameter.default, default=str)}")
    return " ".join(words)


def schema_text(name):
    """The JSON Schema of a message or of the scene file."""
    return json.dumps(MODELS[name].model_json_schema(), indent=2) + "\n"


if __name__ == "__main__":
    SURFACE.write_text(surface(), encoding="utf-8")
    for model in MODELS:
        (SCHEMAS / f"{model}.json").write_text(schema_text(model), encoding="utf-8")
