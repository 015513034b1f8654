"""A program as an FMU for co-simulation: its C, compiled and as sources, in one deterministic archive."""

from __future__ import annotations

import hashlib
import platform
import re
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from io import BytesIO
from pathlib import Path
from typing import Literal, get_args
from xml.etree import ElementTree

from rdpi_gym.firmware.compiling import STRICT, compiler, run
from rdpi_gym.firmware.program import Program
from rdpi_gym.firmware.writing.templating import filled, template
from rdpi_gym.support.errors import InputError, printable
from rdpi_gym.support.files import write_atomic
from rdpi_gym.support.words import quoted

FmiVersion = Literal["2.0", "3.0"]
Causality = Literal["independent", "local", "input", "output"]

FIRST_INPUT = 10
"""Value reference of the first input; what stands below is in ``rdpi_fmu.h``."""
_FLAGS = {
    "controller": {
        "clamped": (3, "The command stood at an end of its range"),
        "saturated": (4, "The reference was outside what the range of commands reaches"),
        "out_of_range": (5, "An input was not finite or absurdly large: the last command was held"),
    },
    "plant": {
        "clamped": (3, "The command was outside its range"),
        "out_of_range": (5, "The command was not finite or absurdly large: the last one was held"),
    },
}
_UNITS: Mapping[str, Mapping[str, str]] = {
    "s": {"s": "1"},
    "V": {"kg": "1", "m": "2", "s": "-3", "A": "-1"},
    "um": {"m": "1", "factor": "1e-06"},
}
_NO_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_LONGEST_IDENTIFIER = 48
_LONGEST_NAME = 200
_LONGEST_DESCRIPTION = 1000


@dataclass(frozen=True)
class Variable:
    """One variable of an FMU."""

    name: str
    reference: int
    description: str
    causality: Causality
    unit: str = ""
    start: float | None = None
    range: tuple[float, float] | None = None


def variables(program: Program) -> list[Variable]:
    """Return the variables of a program's FMU."""
    low, high = (float(end) for end in program.command_range_V)
    found = [
        Variable("time", 0, "Time of the last communication point", "independent", "s"),
        Variable("ts_s", 1, "Sampling time", "local", "s", float(program.ts_s)),
    ]
    reach = f"from {low!r} V to {high!r} V"
    if program.kind == "plant":
        command = f"Command that is held for the step, {reach}"
        output = Variable("displacement_um", 2, "Displacement", "output", "um")
        inputs = [Variable("command_V", FIRST_INPUT, command, "input", "V", float(program.rest_V))]
    else:
        command = f"Command for the next sample, {reach}"
        output = Variable("command_V", 2, command, "output", "V", range=(low, high))
        names = {"reference_um": "Reference r(k)", "measured_um": "Measured displacement y(k)"} | {
            f"reference_ahead_{j}_um": f"Reference r(k+{j})" for j in range(1, program.preview + 1)
        }
        inputs = [
            Variable(name, FIRST_INPUT + place, text, "input", "um", float(program.centre_um))
            for place, (name, text) in enumerate(names.items())
        ]
    flags = [
        Variable(name, reference, f"{text}, in a sample of the last step", "output")
        for name, (reference, text) in _FLAGS[program.kind].items()
    ]
    return [*found, output, *flags, *inputs]


def model_identifier(program: Program) -> str:
    """Return the name of the FMU's binary: an identifier of C, whatever the model is called.

    Only letters and digits of ASCII are kept of the names; what it begins with makes it no word of C
    and no name that a system keeps for itself.
    """
    title = [program.title] if program.kind == "controller" else []
    words = re.findall("[A-Za-z0-9]+", " ".join([*title, program.model]))
    return f"rdpi_{program.kind}_{'_'.join(words)}"[:_LONGEST_IDENTIFIER].rstrip("_")


def model_description(
    program: Program, fmi: FmiVersion, token: str, sources: Sequence[str], tool: str
) -> bytes:
    """Return ``modelDescription.xml``."""
    third = fmi == "3.0"
    identifier, ts_s = model_identifier(program), float(program.ts_s)
    state = "FMUState" if third else "FMUstate"
    listed = variables(program)
    head = {
        "fmiVersion": fmi,
        "modelName": _text(_name(program), _LONGEST_NAME) or identifier,
        "instantiationToken" if third else "guid": token,
        "description": _text(_description(program), _LONGEST_DESCRIPTION),
        "generationTool": tool,
        "variableNamingConvention": "structured",
        **({} if third else {"numberOfEventIndicators": "0"}),
    }
    interface = {
        "modelIdentifier": identifier,
        "canHandleVariableCommunicationStepSize": "false",
        f"canGetAndSet{state}": "true",
        f"canSerialize{state}": "true",
        **({"fixedInternalStepSize": repr(ts_s)} if third
           else {"canNotUseMemoryManagementFunctions": "true"}),
    }  # fmt: skip
    files = _element("SourceFiles", {}, [_element("File", {"name": each}) for each in sources])
    units = [
        _element("Unit", {"name": name}, [_element("BaseUnit", dict(base))])
        for name, base in _UNITS.items()
    ]
    log = {"name": "logStatusError", "description": "Why a call was refused"}
    experiment = {"startTime": "0.0", "stopTime": repr(1000 * ts_s), "stepSize": repr(ts_s)}
    described = [_described(variable, third) for variable in listed]
    # an output is that of the last sample: none depends on what stands at its input now
    outputs = [(k, one.reference) for k, one in enumerate(listed, 1) if one.causality == "output"]
    if third:
        structure = [
            _element(kind, {"valueReference": str(reference), "dependencies": ""})
            for kind in ("Output", "InitialUnknown")
            for _, reference in outputs
        ]
    else:
        structure = [
            _element(kind, {}, [
                _element("Unknown", {"index": str(place), "dependencies": ""}) for place, _ in outputs
            ])
            for kind in ("Outputs", "InitialUnknowns")
        ]  # fmt: skip
    parts = [
        _element("CoSimulation", interface, [] if third else [files]),
        _element("UnitDefinitions", {}, units),
        _element("LogCategories", {}, [_element("Category", log)]),
        _element("DefaultExperiment", experiment),
        _element("ModelVariables", {}, described),
        _element("ModelStructure", {}, structure),
    ]
    return _xml(_element("fmiModelDescription", head, parts))


def build_description(program: Program, sources: Sequence[str]) -> bytes:
    """Return ``sources/buildDescription.xml`` of FMI 3.0."""
    files = [_element("SourceFile", {"name": name}) for name in sources]
    group = _element("SourceFileSet", {"language": "C99"}, files)
    identifier = {"modelIdentifier": model_identifier(program)}
    configuration = _element("BuildConfiguration", identifier, [group])
    return _xml(_element("fmiBuildDescription", {"fmiVersion": "3.0"}, [configuration]))


def _element(
    tag: str, attributes: dict[str, str], children: Sequence[ElementTree.Element] = ()
) -> ElementTree.Element:
    element = ElementTree.Element(tag, attributes)
    element.extend(children)
    return element


_NATURE: Mapping[Causality, dict[str, str]] = {
    "independent": {"variability": "continuous"},
    "local": {"variability": "constant", "initial": "exact"},
    "input": {"variability": "discrete"},
    "output": {"variability": "discrete", "initial": "calculated"},
}


def _described(variable: Variable, third: bool) -> ElementTree.Element:
    common = {
        "name": variable.name,
        "valueReference": str(variable.reference),
        "description": variable.description,
        "causality": variable.causality,
        **_NATURE[variable.causality],
    }
    values = {"unit": variable.unit} if variable.unit else {}
    if variable.range is not None:
        values |= {"min": repr(variable.range[0]), "max": repr(variable.range[1])}
    if variable.start is not None:
        values["start"] = repr(variable.start)
    if third:
        return _element("Float64" if variable.unit else "Boolean", common | values)
    kind = _element("Real" if variable.unit else "Boolean", values)
    return _element("ScalarVariable", common, [kind])


def _description(program: Program) -> str:
    what = "Piezo" if program.kind == "plant" else "Controller of a piezo"
    time = (
        f"{what} actuator with hysteresis, sampled every {program.ts_s:g} s. A communication step is a whole multiple of that; "
        "inputs are held for it."
    )
    return " ".join([time, *program.notes])


def _name(program: Program) -> str:
    return program.model if program.kind == "plant" else f"{program.title}, {program.model}"


def _text(text: str, longest: int) -> str:
    """Return what XML can hold of a text, shortened."""
    return _NO_XML.sub("�", printable(text))[:longest]


def _xml(root: ElementTree.Element) -> bytes:
    ElementTree.indent(root)
    text: str = ElementTree.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'.encode()


# Of a zip archive: the date of every file in it, so that archives are equal.
_EARLIEST = (1980, 1, 1, 0, 0, 0)


def write_fmu(
    program: Program, sources: Mapping[str, str], out: Path, fmi: FmiVersion = "3.0"
) -> Path:
    """Write an FMU for co-simulation, compiled for this machine, with the sources for others.

    Every communication step is a whole multiple of the sampling time; inputs are held for it, and the
    outputs after it are those of its last sample. Two archives of one program are equal byte by byte
    where the compiler is the same.
    """
    if fmi not in get_args(FmiVersion):
        raise InputError(f"FMI {quoted(fmi)} is not written; choose 2.0 or 3.0")
    texts, token = fmu_sources(program, sources, fmi)
    units = [name for name in texts if name.endswith(".c")]
    folder, suffix = binary_place(fmi)
    tool = f"rdpi-gym {version('rdpi-gym')}"
    files = {
        "modelDescription.xml": model_description(program, fmi, token, units, tool),
        f"binaries/{folder}/{model_identifier(program)}{suffix}": _compiled(texts, units, suffix),
        **{f"sources/{name}": text.encode() for name, text in texts.items()},
    }
    if fmi == "3.0":
        files["sources/buildDescription.xml"] = build_description(program, units)
    return write_atomic(out, _archive(files))


def fmu_sources(
    program: Program, sources: Mapping[str, str], fmi: FmiVersion = "3.0"
) -> tuple[dict[str, str], str]:
    """Return the files that an FMU is compiled from, by name, and the token that stands for them."""
    kind = program.kind
    texts = {name: sources[name] for name in (f"rdpi_{kind}.c", f"rdpi_{kind}.h")}
    own = f"rdpi_fmi{fmi[0]}"
    for name in (f"{own}.h", "rdpi_fmu.h", f"rdpi_fmu_{kind}.h"):
        texts[name] = template(f"fmu/{name}")
    texts[f"{own}.c"] = _interface_text(fmi, texts[f"{own}.h"])
    inputs = [one for one in variables(program) if one.causality == "input"]
    values = {
        "KIND": kind,
        "INPUTS": str(len(inputs)),
        "TS": repr(float(program.ts_s)),
        "REST": repr(float(program.rest_V)),
        "START": repr(inputs[0].start),
    }
    model = template("fmu/rdpi_fmu_model.h")
    content = [*texts.items(), ("", filled(model, frozenset(), TOKEN="", **values))]
    digest = hashlib.sha256(repr(content).encode()).digest()
    token = f"{{{uuid.UUID(bytes=digest[:16])}}}"
    texts["rdpi_fmu_model.h"] = filled(model, frozenset(), TOKEN=token, **values)
    return texts, token


_WORDS: Mapping[FmiVersion, Mapping[str, str]] = {
    "2.0": {"F": "fmi2", "HANDLE": "fmi2Component", "REAL": "Real", "STATE": "FMUstate",
            "BEGIN": "SetupExperiment", "READ": "DeSerialize", "COUNT": ""},
    "3.0": {"F": "fmi3", "HANDLE": "fmi3Instance", "REAL": "Float64", "STATE": "FMUState",
            "BEGIN": "EnterInitializationMode", "READ": "Deserialize", "COUNT": ", size_t nValues"},
}  # fmt: skip
_COUNTS = ("nvr", "nValueReferences", "nContinuousStates", "nEventIndicators")
_CO_SIMULATION = "this FMU is for co-simulation"
# By patterns of functions' names, the first that fits.
_REFUSED = {
    "InputDerivatives": "inputs are held for the whole step",
    "OutputDerivatives|Derivative$": "there are no derivatives",
    "Dependencies": "dependencies are in the description",
    "Mode$|DiscreteStates": "the model has no such mode",
    "CancelStep": "no step is under way: a step ends in its call",
}


def _interface_text(fmi: FmiVersion, header: str) -> str:
    """Return ``rdpi_fmi2.c`` or ``rdpi_fmi3.c``: a function for every prototype of the header."""
    part, words = frozenset({"TWO" if fmi == "2.0" else "THREE"}), _WORDS[fmi]
    own = filled(template("fmu/rdpi_fmi.c"), part, VERSION=fmi, REFUSALS="@REFUSALS@", **words)
    macro = re.search(r"#define RDPI_FMI3_ACCESS\(type\) \\\n((?:.*\\\n)*.*)\n", header)
    if macro is not None:
        kinds = re.findall(r"^RDPI_FMI3_ACCESS\((\w+)\);", header, re.MULTILINE)
        access = macro[1].replace("\\\n", "")
        header = header.replace(macro[0], "")
        header += "".join(f"{access.replace('##type', kind)};\n" for kind in kinds)
    prototypes = re.findall(r"FMI\d_Export\s+(\w+)\s+(\w+)\(([^;]*)\);", header)
    refusals = [
        _refusal(returns, name, parameters, words["F"])
        for returns, name, parameters in prototypes
        if f" {name}(" not in own
    ]
    return own.replace("@REFUSALS@", "\n".join(refusals))


def _refusal(returns: str, name: str, parameters: str, prefix: str) -> str:
    """Return a function of the standard that answers that the model has nothing of the kind."""
    parameters = " ".join(parameters.split())
    handle, *others = re.findall(r"(\w+)(?:\[\])?(?:,|$)", parameters)
    count = next((each for each in _COUNTS if f"size_t {each}" in parameters), "")
    why = next((text for key, text in _REFUSED.items() if re.search(key, name)), "")
    if returns.endswith("Instance"):
        others.insert(0, handle)
        body = f'report(logMessage, instanceEnvironment, __func__, "{_CO_SIMULATION}");\n    return NULL;'
    elif name.endswith("Status"):
        body = f"return {handle} != NULL ? {prefix}Discard : {prefix}Error;"
    elif count and not why:
        body = f"return none_of((const instance_t *){handle}, {count}, __func__);"
    else:
        body = f'return refuse((const instance_t *){handle}, __func__, "{why or _CO_SIMULATION}");'
    read = set(re.findall(r"\w+", body))
    unread = "".join(f"    (void){each};\n" for each in others if each not in read)
    return f"{returns} {name}({parameters})\n{{\n{unread}    {body}\n}}\n"


def binary_place(
    fmi: FmiVersion, system: str = sys.platform, machine: str | None = None, bits: int | None = None
) -> tuple[str, str]:
    """Return the folder of a machine's binaries, in ``binaries/``, and the ending of their names."""
    name = (platform.machine() if machine is None else machine).lower()
    wide = sys.maxsize > 2**32 if bits is None else bits == 64
    systems = {"linux": ("linux", ".so"), "darwin": ("darwin", ".dylib"), "win32": ("win", ".dll")}
    intel = {"amd64", "x86_64", "x86", "i386", "i586", "i686"}
    if system not in systems or name not in {*intel, "arm64", "aarch64"}:
        raise InputError(f"FMI has no name for binaries of {system} on {name}; use the C instead")
    short, suffix = systems[system]
    if fmi == "2.0":
        return f"{short}{64 if wide else 32}", suffix
    architecture = ("x86_64" if wide else "x86") if name in intel else "aarch64"
    return f"{architecture}-{'windows' if short == 'win' else short}", suffix


def _compiled(texts: Mapping[str, str], units: Sequence[str], suffix: str) -> bytes:
    """Return the shared library of some files of C."""
    words = compiler()
    with tempfile.TemporaryDirectory(prefix="rdpi-fmu-") as name:
        folder = Path(name)
        for file, text in texts.items():
            (folder / file).write_text(text, encoding="utf-8", newline="\n")
        library = f"model{suffix}"
        # a name that nothing defines is an error here; the compiler's own library is on no other machine
        own = {".so": ("-fPIC", "-Wl,-z,defs"), ".dylib": ("-fPIC",), ".dll": ("-static-libgcc",)}
        words += [*STRICT, *own[suffix], "-fvisibility=hidden", "-shared"]
        done = run([*words, *units, "-o", library, "-lm"], folder)
        if done.returncode:
            lines = [x for x in done.stderr.splitlines() if "error" in x or "undefined" in x]
            reason = lines[0].strip() if lines else f"exit status {done.returncode}"
            raise InputError(f"{words[0]} refuses the code of the FMU: {reason}")
        return (folder / library).read_bytes()


def _archive(files: Mapping[str, bytes]) -> bytes:
    stream = BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name, _EARLIEST)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 3  # Unix, whose rights follow, wherever it is written
            entry.external_attr = (0o100755 if name.startswith("binaries/") else 0o100644) << 16
            archive.writestr(entry, content)
    return stream.getvalue()
