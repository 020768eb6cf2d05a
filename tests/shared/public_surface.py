"""The public surface, written down: every verb with its options, and the schemas of the messages and the scene file.
`make surface` rewrites docs/reference/surface.txt, docs/reference/schema and the completion script. A test compares
them with the code: no change of the surface goes unnoticed."""

import json
import re
from typing import Literal, get_args, get_origin

import typer
from doc_pages import ROOT

import labanmesh
from common import messages
from common.config import Scene
from common.fall_messages import FallMessage, PostureMessage
from common.picture_message import PictureMessage

SURFACE = ROOT / "docs" / "reference" / "surface.txt"
COMPLETION = ROOT / "deploy" / "completion" / "labanmesh.bash"
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
        if get_origin(annotation) is Literal:
            words.append("|".join(get_args(annotation)))
        else:
            (of_one,) = get_args(annotation) or (annotation,)
            words.append(of_one.__name__.upper() + ("" if of_one is annotation else "..."))
        least, most = getattr(parameter, "min", None), getattr(parameter, "max", None)
        words += [f"{least}..{most}"] if (least, most) != (None, None) else []
        words += ["required"] if parameter.required else []
    if parameter.default not in (None, False, ""):
        words.append(f"= {json.dumps(parameter.default, default=str)}")
    return " ".join(words)


BASH = """\
# Made by `make surface`; labanmesh completion prints it.
_labanmesh() {{
    local word=${{COMP_WORDS[COMP_CWORD]}} first=${{COMP_WORDS[1]}} second=${{COMP_WORDS[2]}} words=
    if [ "$COMP_CWORD" -eq 1 ]; then
        words="{verbs}"
    else
        case "$first $second" in
{cases}
        esac
    fi
    # Without a word of ours the shell completes the name of a file.
    case $words in -*) case $word in -*) ;; *) words= ;; esac ;; esac
    COMPREPLY=($(compgen -W "$words" -- "$word"))
}}
complete -o default -F _labanmesh labanmesh
"""


def completion():
    """The completion script for bash. An option of a form, such as `evaluate --paper`, is offered after the verb."""
    cases, verbs = [], {}
    for line in surface().splitlines():
        words = line.split()
        if line.startswith("labanmesh") and "=" not in words:
            verb, *more = words[1:]
            inner = more[0] if more and not more[0].startswith("-") else ""
            options = verbs.setdefault(verb, {}).setdefault(inner, {})
        elif line.startswith("    -"):
            options.update(dict.fromkeys(re.findall(r"(?<!\S)--?[a-z][\w-]*", line)))
    for verb, inners in verbs.items():
        cases += [f'            "{verb} {inner}") words="{" ".join(inners[inner])}" ;;' for inner in inners if inner]
        words = " ".join(inner for inner in inners if inner) or " ".join(inners[""])
        cases.append(f'            "{verb} "*) words="{words}" ;;')
    return BASH.format(verbs=" ".join(verbs), cases="\n".join(cases))


def schema_text(name):
    """The JSON Schema of a message or of the scene file."""
    return json.dumps(MODELS[name].model_json_schema(), indent=2) + "\n"


if __name__ == "__main__":
    SURFACE.write_text(surface(), encoding="utf-8")
    COMPLETION.write_text(completion(), encoding="utf-8")
    for model in MODELS:
        (SCHEMAS / f"{model}.json").write_text(schema_text(model), encoding="utf-8")
